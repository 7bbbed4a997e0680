"""Fig. 4: the angular kernel, by which a neighbour counts towards a direction."""

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

WIDTHS = (1.0, 0.5, 0.25, 0.1, 0.03)
HEIGHTS = (1.0, 0.75, 0.5, 0.25)
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


def figure_4(*, widths: Sequence[float] = WIDTHS, heights: Sequence[float] = HEIGHTS) -> Figure:
    """Draw the angular kernel for several widths at height 1, and for several heights.

    Parameters
    ----------
    widths
        sigma_w of the left panel, at most five.
    heights
        sigma_h of the right panel, at most five.
    """
    figure = new_figure(3.1)
    phi = np.linspace(-np.pi, np.pi, 721)
    panels = (
        (0.075, f"widths σ$_w$, at height σ$_h$ = {1:g}", [(w, 1.0, w) for w in widths]),
        (
            0.565,
            f"heights σ$_h$, at width σ$_w$ = {_HEIGHT_WIDTH:g}",
            [(_HEIGHT_WIDTH, h, h) for h in heights],
        ),
    )
    for left, title, curves in panels:
        axes = add_panel(figure, left, 0.18, 0.36, 0.68)
        for shade, (width, height, shown) in zip(_SHADES, curves, strict=False):
            values = angular_kernel(phi, width=width, height=height)
            axes.plot(phi, values, color=rgba(shade), lw=2.0, label=f"{shown:g}")
        axes.set_xlim(-np.pi, np.pi)
        axes.set_ylim(0.0, 1.05)
        axes.set_xticks(
            np.pi * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), ["−π", "−π/2", "0", "π/2", "π"]
        )
        axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0])
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
    figure.axes[0].set_ylabel("k$_φ$(φ)", fontsize=NORMAL, color=INK)
    return figure
