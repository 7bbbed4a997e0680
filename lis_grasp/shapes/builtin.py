"""The paper's objects (Ottenhaus et al. 2016, section IV.A), exact, of any size.

The paper gives the shapes and their diameter, 20 cm, but not their proportions. Ours make an
object of graspable size 4 to 10 cm wide where a hand closes on it from above, and high enough for
the fingertips to clear the table. Curved faces are inscribed polyhedra whose chords are within
0.1 mm of the true shape at the paper's size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, shown
from lis_grasp.io.units import LARGEST, SMALLEST
from lis_grasp.shapes.shape import Shape, sharp_edges
from lis_grasp.shapes.tessellation import (
    at_height,
    cap,
    circle,
    geodesic_sphere,
    join,
    polygon,
    prism,
    stack,
)

PAPER_SIZE = 0.20
"""Largest extent of the paper's objects [m]."""


def box(size: float = PAPER_SIZE) -> Shape:
    """Return an upright box, `size` high, 0.7 by 0.5 `size` wide; its faces look along the axes."""
    _require_size(size)
    outline = polygon(_rectangle(0.35 * size, 0.25 * size), 14)
    return _shape("box", prism(outline, size, sectors=4, rows=22))


def cylinder(size: float = PAPER_SIZE) -> Shape:
    """Return an upright cylinder, `size` high and 0.6 `size` in diameter."""
    _require_size(size)
    return _shape("cylinder", prism(circle(0.3 * size, 96), size, sectors=6, rows=32))


def half_cylinder(size: float = PAPER_SIZE) -> Shape:
    """Return half of a cylinder cut along its axis: `size` high, 0.8 `size` in diameter.

    It rests on its half disc; the flat face looks to -y, the round one to +y.
    """
    _require_size(size)
    radius = 0.4 * size
    arc = circle(radius, 128)[:65]  # both ends included
    flat = np.linspace(arc[-1], arc[0], 33)[1:-1]
    outline = np.concatenate([arc, flat]) - [0.0, radius / 2.0]
    return _shape("half_cylinder", prism(outline, size, sectors=6, rows=32))


def hollow_cylinder(size: float = PAPER_SIZE) -> Shape:
    """Return an upright tube open at both ends, `size` high, 0.7 `size` wide, bore 0.45 `size`."""
    _require_size(size)
    outer, inner = circle(0.35 * size, 96), circle(0.225 * size, 96)
    low, high = -size / 2.0, size / 2.0
    places = ((outer, low), (outer, high), (inner, high), (inner, low))
    rings = [at_height(ring, z) for ring, z in places]
    mesh = join([stack(rings, [32, 6, 32, 6], closed=True)])
    return _shape("hollow_cylinder", mesh)


def sphere(size: float = PAPER_SIZE) -> Shape:
    """Return a sphere of diameter `size`."""
    _require_size(size)
    return _shape("sphere", geodesic_sphere(size / 2.0, 22))


def torus(size: float = PAPER_SIZE) -> Shape:
    """Return a horizontal torus, `size` across; its tube and its hole are `size` / 3 wide."""
    _require_size(size)
    tube = circle(size / 6.0, 60)  # (radial, z) about the tube's centre
    rings = [at_height(circle(size / 3.0 + r, 128), z) for r, z in tube]
    return _shape("torus", join([stack(rings, [1] * len(rings), closed=True)]))


def pentagon(size: float = PAPER_SIZE) -> Shape:
    """Return an upright regular pentagonal prism, `size` high, its corners on a circle.

    The circle is 0.75 `size` in diameter; one corner is in the direction +y.
    """
    _require_size(size)
    radius = 0.375 * size
    corners = circle(radius, 5, start=np.pi / 2.0)
    corners[:, 1] -= radius * (1.0 - np.cos(np.pi / 5.0)) / 2.0  # bounding box about the origin
    return _shape("pentagon", prism(polygon(corners, 12), size, sectors=5, rows=24))


def mallet(size: float = PAPER_SIZE) -> Shape:
    """Return a mallet upright on its head: a box with a round handle upwards, `size` in all.

    The head is 0.7 by 0.4 `size` wide and 0.4 `size` high, the handle 0.28 `size` thick. Where the
    handle meets the head, the surface has a concave circular edge.
    """
    _require_size(size)
    head = polygon(_rectangle(0.35 * size, 0.2 * size), 18)
    handle = circle(0.14 * size, len(head), start=-np.pi / 4.0)
    low, neck, high = -size / 2.0, -0.1 * size, size / 2.0
    places = ((head, low), (head, neck), (handle, neck), (handle, high))
    rings = [at_height(ring, z) for ring, z in places]
    caps = [cap(rings[0], 4, up=False), cap(rings[-1], 4, up=True)]
    return _shape("mallet", join([caps[0], stack(rings, [12, 8, 40]), caps[1]]))


_ALL = (box, cylinder, half_cylinder, hollow_cylinder, sphere, torus, pentagon, mallet)

BUILDERS: Mapping[str, Callable[[float], Shape]] = MappingProxyType(
    {builder.__name__: builder for builder in _ALL}
)
"""The function that builds each built-in shape of a given size [m]."""

NAMES = tuple(BUILDERS)
"""Names of the built-in shapes."""

GRASPABLE_SIZES: Mapping[str, float] = MappingProxyType(
    {name: {"sphere": 0.10, "mallet": 0.14}.get(name, 0.12) for name in NAMES}
)
"""Largest extent at which a hand of human size grasps each shape from above [m]."""


def build(name: str, size: float | None = None) -> Shape:
    """Return a built-in shape.

    Parameters
    ----------
    name
        One of `NAMES`.
    size
        Largest extent [m]; None for the size that a hand can grasp, `PAPER_SIZE` for the paper's.

    Raises
    ------
    InvalidOptionError
        If there is no such shape, or the size is no plausible length in metres.
    """
    if name not in BUILDERS:
        raise InvalidOptionError.not_one_of("shape", name, NAMES)
    return BUILDERS[name](GRASPABLE_SIZES[name] if size is None else size)


def _shape(name: str, mesh: trimesh.Trimesh) -> Shape:
    return Shape(name, mesh, sharp_edges(mesh))


def _rectangle(a: float, b: float) -> list[tuple[float, float]]:
    return [(a, -b), (a, b), (-a, b), (-a, -b)]


def _require_size(size: float) -> None:
    if not SMALLEST <= size <= LARGEST:
        metres = 1e-3 * size
        advice = f": {size:g} mm are {metres:g} m" if SMALLEST <= metres <= LARGEST else ""
        raise InvalidOptionError(
            f"size must be a largest extent from {SMALLEST} to {LARGEST} m; it is"
            f" {shown(size)}{advice}",
            option="size",
            value=size,
        )
