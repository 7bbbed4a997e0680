"""Worlds for tests: bins, shelves, corners and free blocks beside an object at the origin.

Lengths in metres. `table` is the height of the table in the frame E.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lis_grasp.world import Body, Surroundings

BLOCK = (0.06, 0.06, 0.1)
BLOCK_MASS = 0.3  # [kg]
_THICKNESS = 0.02
_SIDES = {"east": (1, 0), "west": (-1, 0), "north": (0, 1), "south": (0, -1)}


def walls(
    apart: float, height: float, sides: tuple[str, ...] = tuple(_SIDES), *, table: float = 0.0
) -> Surroundings:
    """Return upright walls of a height whose inner faces are `apart` from the opposite ones."""
    away = 0.5 * (apart + _THICKNESS)
    bodies = []
    for side in sides:
        x, y = _SIDES[side]
        along = apart + 2.0 * _THICKNESS if x else apart
        size = (_THICKNESS, along, height) if x else (along, _THICKNESS, height)
        center = (away * x, away * y, table + 0.5 * height)
        bodies.append(Body.box(side, size, center))
    return Surroundings(tuple(bodies))


def bin_(*, table: float = 0.0) -> Surroundings:
    """Return four walls, 100 mm high and 0.30 m apart."""
    return walls(0.3, 0.1, table=table)


def tight_bin(*, table: float = 0.0) -> Surroundings:
    """Return four walls, 140 mm high and 0.20 m apart."""
    return walls(0.2, 0.14, table=table)


def slot(*, table: float = 0.0) -> Surroundings:
    """Return two walls, 160 mm high and 0.15 m apart."""
    return walls(0.15, 0.16, ("north", "south"), table=table)


def corner(*, table: float = 0.0) -> Surroundings:
    """Return two walls, 150 mm high, whose faces are 100 mm from the object's centre."""
    return Surroundings(
        (
            Body.box("east", (0.05, 0.5, 0.15), (0.125, 0.0, table + 0.075)),
            Body.box("north", (0.3, 0.05, 0.15), (-0.05, 0.125, table + 0.075)),
        )
    )


def shelf(*, under: float = 0.34, table: float = 0.0) -> Surroundings:
    """Return a shelf, 0.56 m wide and open to -x, whose board is `under` above the table."""
    board, middle = table + under + 0.5 * _THICKNESS, table + 0.5 * under
    return Surroundings(
        (
            Body.box("board", (0.4, 0.6, _THICKNESS), (0.0, 0.0, board)),
            Body.box("back", (_THICKNESS, 0.6, under), (0.19, 0.0, middle)),
            Body.box("left", (0.36, _THICKNESS, under), (0.0, 0.29, middle)),
            Body.box("right", (0.36, _THICKNESS, under), (0.0, -0.29, middle)),
        )
    )


def low_shelf(*, table: float = 0.0) -> Surroundings:
    """Return a shelf whose board is 0.22 m above the table."""
    return shelf(under=0.22, table=table)


def closed_box(*, table: float = 0.0) -> Surroundings:
    """Return four walls, 0.4 m high and apart, with a lid: nothing gets in."""
    lid = Body.box("lid", (0.44, 0.44, _THICKNESS), (0.0, 0.0, table + 0.4 + 0.5 * _THICKNESS))
    return Surroundings((*walls(0.4, 0.4, table=table), lid))


def blocks(
    gap: float = 0.03,
    sides: tuple[str, ...] = ("east", "west"),
    *,
    half_extents: tuple[float, float] = (0.042, 0.03),
    mass: float | None = BLOCK_MASS,
    table: float = 0.0,
) -> Surroundings:
    """Return boxes of 60 x 60 x 100 mm beside an object, free unless their mass is None.

    `half_extents` are those of the object along x and y, those of the built-in box by default.
    """
    bodies = []
    for side in sides:
        direction = np.array(_SIDES[side])
        x, y = (np.array(half_extents) + gap + 0.5 * BLOCK[0]) * direction
        center = (float(x), float(y), table + 0.5 * BLOCK[2])
        bodies.append(Body.box(f"block_{side}", BLOCK, center, mass=mass))
    return Surroundings(tuple(bodies))


def block(
    gap: float = 0.03, side: str = "east", *, mass: float | None = BLOCK_MASS, table: float = 0.0
) -> Surroundings:
    """Return one box beside the built-in box, as `blocks` does."""
    return blocks(gap, (side,), mass=mass, table=table)


def saved(surroundings: Surroundings, path: Path) -> Path:
    """Write boxes as an SDF world, whose z = 0 is the table, and return its path."""
    models = []
    for body in surroundings:
        (geometry,) = body.geometries
        size, pose = _numbers(geometry.dimensions), [*body.X_EB[:3, 3], 0.0, 0.0, 0.0]
        inertial = ""
        if body.inertial is not None:
            moments = dict(
                zip(("ixx", "iyy", "izz"), np.diag(body.inertial.inertia_L), strict=True)
            )
            inertia = "".join(
                f"<{name}>{float(value)!r}</{name}>" for name, value in moments.items()
            )
            mass = f"<mass>{body.inertial.mass}</mass>"
            inertial = f"<inertial>{mass}<inertia>{inertia}</inertia></inertial>"
        shape = f"<geometry><box><size>{size}</size></box></geometry>"
        models.append(
            f'<model name="{body.name}"><static>{str(body.is_fixed).lower()}</static>'
            f"<pose>{_numbers(pose)}</pose>"
            f'<link name="base">{inertial}<collision name="c">{shape}</collision></link></model>'
        )
    text = f'<sdf version="1.7"><world name="w">{"".join(models)}</world></sdf>'
    path.write_text(text, encoding="utf-8")
    return path


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
