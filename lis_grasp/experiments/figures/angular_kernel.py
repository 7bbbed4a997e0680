"""Fig. 4: the angular kernel, the weight of a neighbour towards a direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from lis_grasp.experiments.figures.palette import INK, rgba
from lis_grasp.experiments.figures.style import (
    NORMAL,
    SMALL,
    add_panel,
    head,
    new_figure,
    plain_axes,
)
from lis_grasp.typing import FloatArray

_WIDTHS = (1.0, 0.5, 0.25, 0.1, 0.03)
_HEIGHTS = (1.0, 0.75, 0.5, 0.25)
_HEIGHT_WIDTH = 0.25

# From dark to light: one colour in steps of lightness, since the curves are an ordered family.
_SHADES = ("#08306b", "#2166ac", "#4d94c8", "#87b9dc", "#b3cde3")


def angular_kernel(phi: npt.ArrayLike, *, width: float, height: float) -> FloatArray:
    """Return k_phi = height exp(-sin^2(phi / 2) / (2 width^2)) (Ottenhaus et al. 2016, eq. 11).

    Parameters
    ----------
    phi
        Angle from the neighbour's direction [rad], any shape.
    width, height
        sigma_w (eq. 13) and sigma_h (eq. 12), above 0.
    """
    return height * np.exp(-0.5 * (np.sin(0.5 * np.asarray(phi)) / width) ** 2)


def figure_4() -> Figure:
    """Draw the angular kernel for several widths at height 1, and for several heights."""
    figure = new_figure(3.1)
    widths = f"widths σ$_w$, at height σ$_h$ = {1:g}", [(w, 1.0, w) for w in _WIDTHS]
    heights = (
        f"heights σ$_h$, at width σ$_w$ = {_HEIGHT_WIDTH:g}",
        [(_HEIGHT_WIDTH, h, h) for h in _HEIGHTS],
    )
    _draw_kernels(figure, 0.075, *widths)
    _draw_kernels(figure, 0.565, *heights)
    figure.axes[0].set_ylabel("k$_φ$(φ)", fontsize=NORMAL, color=INK)
    return figure


def _draw_kernels(
    figure: Figure, left: float, title: str, kernels: Sequence[tuple[float, float, float]]
) -> None:
    """Draw kernels, each a width, a height and the number shown in the legend."""
    axes = add_panel(figure, left, 0.18, 0.36, 0.68)
    phi = np.linspace(-np.pi, np.pi, 721)
    for shade, (width, height, shown) in zip(_SHADES, kernels, strict=False):
        values = angular_kernel(phi, width=width, height=height)
        axes.plot(phi, values, color=rgba(shade), lw=2.0, label=f"{shown:g}")
    axes.set(xlim=(-np.pi, np.pi), ylim=(0.0, 1.05), yticks=[0.0, 0.25, 0.5, 0.75, 1.0])
    axes.set_xticks(np.pi * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), ["−π", "−π/2", "0", "π/2", "π"])
    axes.set_xlabel("φ, angle from the neighbour’s direction", fontsize=NORMAL, color=INK)
    plain_axes(axes)
    axes.legend(
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
        fontsize=SMALL,
        handlelength=1.4,
    )
    head(axes, title)
