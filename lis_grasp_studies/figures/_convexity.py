"""Figs. 4 and 5: the angular kernel, and the local convexity of every contact as a disc."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from lis_grasp.geometry import tangent_frame
from lis_grasp.surfaces import LocalImplicitSurface
from lis_grasp.typing import FloatArray
from lis_grasp.visualization.camera import View
from lis_grasp_studies.figures import palette, style
from lis_grasp_studies.figures._solids import KERNEL_WIDTH, LIFT, solid_patches, view_of
from lis_grasp_studies.figures.painter import (
    Patches,
    line_patches,
    paint,
    point_patches,
    triangle_patches,
)
from lis_grasp_studies.paper.trials import explored

_WIDTHS = (1.0, 0.5, 0.25, 0.1, 0.03)
_HEIGHTS = (1.0, 0.75, 0.5, 0.25)
_HEIGHT_WIDTH = 0.25

# From dark to light: one colour in steps of lightness, since the curves are an ordered family.
_SHADES = ("#08306b", "#2166ac", "#4d94c8", "#87b9dc", "#b3cde3")

_WEDGES = 48
_RADIUS = 0.013
_ABOVE = 0.001  # height of a disc above the surface [m]


def angular_kernel(phi: npt.ArrayLike, *, width: float, height: float) -> FloatArray:
    """Return k_phi = height exp(-sin^2(phi / 2) / (2 width^2)) (Ottenhaus et al. 2016, eq. 11).

    `phi` is the angle from the neighbour's direction [rad], any shape; `width` is sigma_w (eq. 13)
    and `height` sigma_h (eq. 12), both above 0.
    """
    return height * np.exp(-0.5 * (np.sin(0.5 * np.asarray(phi)) / width) ** 2)


def figure_4() -> Figure:
    """Draw the angular kernel for several widths at height 1, and for several heights."""
    figure = style.new_figure(3.1)
    title = "widths σ$_w$, at height σ$_h$ = 1"
    _draw_kernels(figure, 0.075, title, [(w, 1.0, w) for w in _WIDTHS])
    title = f"heights σ$_h$, at width σ$_w$ = {_HEIGHT_WIDTH:g}"
    _draw_kernels(figure, 0.56, title, [(_HEIGHT_WIDTH, h, h) for h in _HEIGHTS])
    figure.axes[0].set_ylabel("k$_φ$(φ)")
    return figure


def _draw_kernels(
    figure: Figure, left: float, title: str, kernels: Sequence[tuple[float, float, float]]
) -> None:
    """Draw kernels, each a width, a height and the number shown in the legend."""
    axes = style.add_panel(figure, left, 0.18, 0.34, 0.68)
    phi = np.linspace(-np.pi, np.pi, 721)
    for shade, (width, height, shown) in zip(_SHADES, kernels, strict=False):
        values = angular_kernel(phi, width=width, height=height)
        axes.plot(phi, values, color=palette.rgba(shade), lw=2.0, label=f"{shown:g}")
    axes.set(xlim=(-np.pi, np.pi), ylim=(0.0, 1.05), yticks=[0.0, 0.25, 0.5, 0.75, 1.0])
    axes.set_xticks(np.pi * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), ["−π", "−π/2", "0", "π/2", "π"])
    style.label_axes(axes, "φ, angle from the neighbour’s direction", "")
    legend = axes.legend(loc="center left", frameon=False, fontsize=style.SMALL, handlelength=0.9)
    legend.set_bbox_to_anchor((1.0, 0.5))
    style.head(axes, title)


def figure_5(*, names: Sequence[str] = ("mallet", "hollow_cylinder"), seed: int = 0) -> Figure:
    """Draw fully explored objects with the local convexity that LIS estimates at each contact.

    `seed` is that of the walks that made the contacts.
    """
    figure = style.new_figure(4.9)
    width = 1.0 / len(names)
    for k, name in enumerate(names):
        (shape, walk), view = explored(name, seed), view_of(name)
        surface = LocalImplicitSurface.from_contacts(
            walk.contacts, sigma=KERNEL_WIDTH * walk.contacts.spacing
        )
        axes = style.add_panel(figure, (k + 0.03) * width, 0.17, 0.94 * width, 0.81)
        paint(axes, [*solid_patches(view, shape.mesh), *_disc_patches(view, surface)])
        style.foot_note(axes, f"{name.replace('_', ' ')}, {len(surface.points)} contacts")
    style.colour_bar(
        figure,
        (0.34, 0.085, 0.32, 0.018),
        palette.CONVEX_CONCAVE,
        "β* towards each direction in the contact’s plane",
        {-1.0: "−1, convex", 0.0: "0, flat", 1.0: "1, concave"},
    )
    return figure


def _disc_patches(view: View, surface: LocalImplicitSurface) -> list[Patches]:
    """Return the disc of every contact that faces the eye, its rim and its middle."""
    assert surface.convexity is not None
    angles = np.linspace(0.0, 2.0 * np.pi, _WEDGES + 1)
    middles = 0.5 * (angles[1:] + angles[:-1])
    patches: list[Patches] = []
    for i in np.flatnonzero(view.faces(surface.normals)):
        normal, center = surface.normals[i], surface.points[i] + _ABOVE * surface.normals[i]
        plane = tangent_frame(normal)
        rim = center + _RADIUS * around(angles, plane)  # (W + 1, 3)
        beta, _ = surface.convexity.evaluate(int(i), around(middles, plane))
        wedges = np.stack([np.broadcast_to(center, rim[1:].shape), rim[:-1], rim[1:]], axis=1)
        facing = np.broadcast_to(view.axes[2], wedges[:, 0].shape)  # full light: colours are data
        # All parts at the depth of the disc's nearest point: drawn in this order.
        depth = float(view.project(rim)[1].max()) + LIFT
        parts = [
            triangle_patches(view, wedges, facing, palette.convexity_colours(beta)),
            line_patches(view, np.stack([rim[:-1], rim[1:]], axis=1), palette.INK, width=0.0008),
            point_patches(view, center[None], palette.INK, radius=0.0014),
        ]
        patches += [replace(part, depths=np.full(len(part.depths), depth)) for part in parts]
    return patches


def around(angles: FloatArray, plane: FloatArray) -> FloatArray:
    """Return unit vectors (R, 3) at angles (R,) [rad] in a plane given by two axes (2, 3)."""
    return np.column_stack([np.cos(angles), np.sin(angles)]) @ plane
