"""Objects that nobody saw before: made from a salt, of six families."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from types import MappingProxyType

import manifold3d
import numpy as np

from lis_grasp.geometry import unit
from lis_grasp.shapes import Shape, sharp_edges
from lis_grasp.typing import FloatArray
from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    block,
    extrude,
    mesh_of,
    outline,
    revolve,
    star,
    superquadric,
)

SIZES = (0.06, 0.1)
"""Least and largest extent of the longest side [m]: a hand can hold all of them."""

_BLOB_SEGMENTS = 48  # about the axis of a blob


def salted_shape(
    salt: str,
    number: int,
    families: Mapping[str, Callable[[np.random.Generator], Solid]] | None = None,
) -> Shape:
    """Return one object of a salt: its family is that of its number, the rest is random.

    The families are `FAMILIES` by default.

    Examples
    --------
    >>> salted_shape("pepper", 0).name, salted_shape("pepper", 0).mesh.is_watertight
    ('prism-0', True)
    """
    families = FAMILIES if families is None else families
    family = tuple(families)[number % len(families)]
    digest = hashlib.sha256(f"{salt}/{number}".encode()).digest()
    rng = np.random.default_rng(list(digest))
    mesh = mesh_of(families[family](rng))
    mesh.apply_scale(rng.uniform(*SIZES) / float(mesh.extents.max()))
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return Shape(f"{family}-{number}", mesh, sharp_edges(mesh))


def _polygon(rng: np.random.Generator, sides: int, low: float, high: float) -> FloatArray:
    """Return corners (sides, 2) of a polygon about the origin, with alternating radii."""
    steps = 1.0 + rng.uniform(-0.25, 0.25, sides)
    angles = 2.0 * np.pi * np.cumsum(steps) / steps.sum()
    radii = np.where(np.arange(sides) % 2, low, high)
    return radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


def _prism(rng: np.random.Generator) -> Solid:
    corners = _polygon(rng, int(rng.integers(3, 8)), 1.0, 1.0)
    return extrude(outline(corners), rng.uniform(0.7, 2.2))


def _frustum(rng: np.random.Generator) -> Solid:
    corners = _polygon(rng, int(rng.integers(3, 8)), 1.0, 1.0)
    return extrude(outline(corners), rng.uniform(0.8, 1.8), top=rng.uniform(0.35, 0.75))


def _star(rng: np.random.Generator) -> Solid:
    corners = _polygon(rng, 2 * int(rng.integers(4, 7)), rng.uniform(0.55, 0.8), 1.0)
    return extrude(outline(corners), rng.uniform(0.5, 1.2))


def _bracket(rng: np.random.Generator) -> Solid:
    """Return two or three blocks that meet at right angles, like an L, a T or a U."""
    long, thick, deep = 1.0, rng.uniform(0.25, 0.4), rng.uniform(0.4, 0.8)
    solid = block(long, deep, thick)
    for place in rng.choice([-0.5, 0.0, 0.5], int(rng.integers(1, 3)), replace=False):
        height = rng.uniform(0.35, 0.8)
        wall = block(thick, deep, height + thick)
        solid = solid + wall.translate((place * (long - thick), 0.0, 0.5 * height))
    return solid


def _notched(rng: np.random.Generator) -> Solid:
    """Return a block without a smaller one, turned, at one of its edges."""
    sides = rng.uniform(0.5, 1.0, 3)
    cut = block(*(2.0 * rng.uniform(0.3, 0.45, 3) * sides)).rotate((0.0, 0.0, rng.uniform(-30, 30)))
    return block(*sides) - cut.translate((0.5 * sides[0], 0.0, 0.5 * sides[2]))


def _rock(rng: np.random.Generator) -> Solid:
    """Return the hull of points on an ellipsoid."""
    directions = unit(rng.normal(size=(int(rng.integers(9, 16)), 3)))
    return manifold3d.Manifold.hull_points(directions * rng.uniform(0.55, 1.0, 3))


def _turned(rng: np.random.Generator) -> Solid:
    """Return two to four conical pieces on one axis, with rims between them."""
    count = int(rng.integers(3, 6))
    radii = rng.uniform(0.35, 1.0, count)
    heights = np.cumsum(rng.uniform(0.3, 1.0, count))
    rims = np.column_stack([radii, heights])
    return revolve(np.vstack([[0.0, heights[0]], rims, [0.0, heights[-1]]]))


def _blob(rng: np.random.Generator) -> Solid:
    """Return a smooth body: an ellipsoid with a few waves on it."""
    ways, heights = unit(rng.normal(size=(4, 3))), rng.uniform(-0.25, 0.25, 4)
    shape = superquadric(rng.uniform(0.6, 1.0, 3), 2.0)
    return star(
        lambda d: shape(d) * (1.0 + (heights * np.cos(2.5 * (d @ ways.T))).sum(axis=1)),
        segments=_BLOB_SEGMENTS,
    )


FAMILIES: Mapping[str, Callable[[np.random.Generator], Solid]] = MappingProxyType(
    {
        "prism": _prism,
        "frustum": _frustum,
        "star": _star,
        "bracket": _bracket,
        "notched": _notched,
        "rock": _rock,
    }
)
"""How each family's solids are made, at any scale."""

MIXED_FAMILIES: Mapping[str, Callable[[np.random.Generator], Solid]] = MappingProxyType(
    {
        **{name: FAMILIES[name] for name in ("prism", "bracket", "notched", "rock")},
        "turned": _turned,
        "blob": _blob,
    }
)
"""Four families with flat faces, one with rims between curved faces, and one without edges."""

EDGED_FAMILIES: Mapping[str, Callable[[np.random.Generator], Solid]] = MappingProxyType(
    {**FAMILIES, "turned": _turned}
)
"""The families with flat faces, and one with rims between curved faces: all have edges."""
