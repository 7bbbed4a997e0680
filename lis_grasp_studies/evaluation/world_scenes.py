"""Scenes beside an object at the origin of a table: 24 by name, neighbours drawn by seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import trimesh

from lis_grasp.robots.robot_model import Inertial, LinkGeometry
from lis_grasp.world import Body, Surroundings

_THICK = 0.02  # of walls and boards [m]
_SIDES = {"east": (1, 0), "west": (-1, 0), "north": (0, 1), "south": (0, -1)}
_TWIN_GAP, _TWIN_MASS = 0.03, 0.2  # [m], [kg]
_NEIGHBOURS = ((1, 10), (1, 30), (2, 10), (2, 30), (2, 50), (3, 30), (4, 30), (4, 50))


def make_scene(name: str, mesh: trimesh.Trimesh, *, seed: int) -> Surroundings:
    """Return the bodies of a scene beside an object's mesh [m], which stands at the origin.

    Walls, boards and gaps are those of the scene; sizes and masses of neighbours, and the sides
    on which they are, depend on the seed.
    """
    make = _closed if name == CLOSED else _SCENES[name]
    return make(mesh, np.random.default_rng([seed, *name.encode()]))


def _walls(apart: float, height: float, sides: tuple[str, ...] = tuple(_SIDES)) -> Surroundings:
    """Return upright walls whose inner faces are `apart` from the opposite ones [m]."""
    away, bodies = 0.5 * (apart + _THICK), []
    for side in sides:
        x, y = _SIDES[side]
        long = apart + 2.0 * _THICK
        size = (_THICK, long, height) if x else (apart, _THICK, height)
        bodies.append(Body.box(side, size, (away * x, away * y, 0.5 * height)))
    return Surroundings(tuple(bodies))


def _shelf(under: float) -> Surroundings:
    """Return a shelf, 0.56 m wide and open to -x, whose board is `under` above the table [m]."""
    board = Body.box("board", (0.4, 0.6, _THICK), (0.0, 0.0, under + 0.5 * _THICK))
    back = Body.box("back", (_THICK, 0.6, under), (0.19, 0.0, 0.5 * under))
    sides = (
        Body.box(name, (0.36, _THICK, under), (0.0, y, 0.5 * under))
        for name, y in (("left", 0.29), ("right", -0.29))
    )
    return Surroundings((board, back, *sides))


def _closed(mesh: trimesh.Trimesh, rng: np.random.Generator) -> Surroundings:
    """Return a box with a lid, into which there is no way."""
    lid = Body.box("lid", (0.34, 0.34, _THICK), (0.0, 0.0, 0.2 + 0.5 * _THICK))
    return Surroundings((*_walls(0.3, 0.2), lid))


def _corner() -> Surroundings:
    east = Body.box("east", (_THICK, 0.4, 0.15), (0.11, 0.0, 0.075))
    return Surroundings((east, Body.box("north", (0.4, _THICK, 0.15), (-0.1, 0.21, 0.075))))


def _wall(mesh: trimesh.Trimesh) -> Surroundings:
    """Return a wall 5 mm beside the object."""
    face = float(mesh.bounds[1, 0]) + 0.005
    return Surroundings((Body.box("wall", (_THICK, 0.4, 0.2), (face + 0.5 * _THICK, 0.0, 0.1)),))


def _twin(mesh: trimesh.Trimesh) -> Surroundings:
    """Return a free copy of the object beside it."""
    inertia = mesh.moment_inertia * (_TWIN_MASS / mesh.volume)
    inertial = Inertial(_TWIN_MASS, np.array(mesh.center_mass), np.array(inertia))
    X_EB = np.eye(4)
    X_EB[1, 3] = float(np.ptp(mesh.bounds[:, 1])) + _TWIN_GAP
    shape = LinkGeometry("twin", np.eye(4), "mesh", (), mesh)
    return Surroundings((Body("twin", (shape,), X_EB, inertial),))


def _neighbours(
    mesh: trimesh.Trimesh, rng: np.random.Generator, count: int, gap: float, *, free: bool
) -> Surroundings:
    """Return boxes on sides of the object, a gap from its bounding box [m]."""
    low, high = np.asarray(mesh.bounds)
    bodies = []
    for k, side in enumerate(rng.permutation(list(_SIDES))[:count]):
        sides = np.append(rng.uniform(0.04, 0.07, 2), rng.uniform(0.06, 0.14))
        mass = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
        direction = np.array(_SIDES[str(side)])
        face = np.where(direction > 0, high[:2], -low[:2]) @ np.abs(direction)
        x, y = direction * (face + gap + 0.5 * sides[:2] @ np.abs(direction))
        size = (float(sides[0]), float(sides[1]), float(sides[2]))
        center = (float(x), float(y), 0.5 * size[2])
        bodies.append(Body.box(f"block {k + 1}", size, center, mass=mass if free else None))
    return Surroundings(tuple(bodies))


_Maker = Callable[[trimesh.Trimesh, np.random.Generator], Surroundings]


def _neighbour_scenes() -> dict[str, _Maker]:
    scenes: dict[str, _Maker] = {}
    for free in (False, True):
        for count, millimetres in _NEIGHBOURS:

            def make(
                mesh: trimesh.Trimesh,
                rng: np.random.Generator,
                count: int = count,
                gap: float = 1e-3 * millimetres,
                free: bool = free,
            ) -> Surroundings:
                return _neighbours(mesh, rng, count, gap, free=free)

            scenes[f"{count} {'free' if free else 'fixed'} at {millimetres} mm"] = make
    return scenes


_SCENES: Mapping[str, _Maker] = {
    "bin": lambda mesh, rng: _walls(0.3, 0.1),
    "tight bin": lambda mesh, rng: _walls(0.2, 0.14),
    "shelf": lambda mesh, rng: _shelf(0.34),
    "low shelf": lambda mesh, rng: _shelf(0.22),
    "corner": lambda mesh, rng: _corner(),
    "slot": lambda mesh, rng: _walls(0.15, 0.16, ("north", "south")),
    "wall at 5 mm": lambda mesh, rng: _wall(mesh),
    "twin": lambda mesh, rng: _twin(mesh),
    **_neighbour_scenes(),
}

SCENES = tuple(_SCENES)
"""Names of the scenes that an object can be taken from."""
CLOSED = "closed box"
"""Name of a scene without a way in."""


def is_tight(scene: str) -> bool:
    """Return whether a scene leaves a hand little room."""
    named = scene in ("tight bin", "slot", "low shelf", "wall at 5 mm")
    return named or scene.endswith(" at 10 mm")
