"""The test objects by name: development and evaluation shapes, disjoint, each with its family.

Settings and constants are chosen on DEVELOPMENT shapes only. EVALUATION shapes, and scans from a
folder, measure what was chosen. No evaluation shape is a rescaled development shape.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.shapes import Shape
from lis_grasp_studies.test_objects import _hard as hard
from lis_grasp_studies.test_objects import _mixed as mixed
from lis_grasp_studies.test_objects import _organic as organic
from lis_grasp_studies.test_objects import _simple as simple
from lis_grasp_studies.test_objects import _thin as thin
from lis_grasp_studies.test_objects.solid_modelling import Solid, mesh_of

Family = Literal["prismatic", "curved", "organic", "mixed", "thin", "scans"]
"""Planes only; bodies of revolution and cylinders; smooth everywhere; planes, curves and fillets
joined; plates, sheets and rods; scans of real objects."""

FAMILIES: tuple[Family, ...] = get_args(Family)

BUILT_IN_SIZES: Mapping[str, float] = MappingProxyType(
    {
        "box": 0.16,
        "cylinder": 0.20,
        "half_cylinder": 0.12,
        "hollow_cylinder": 0.18,
        "sphere": 0.10,
        "torus": 0.20,
        "pentagon": 0.14,
        "mallet": 0.22,
    }
)
"""Largest extent of the built-in shapes among the development shapes [m]."""

DEVELOPMENT: Mapping[Family, tuple[str, ...]] = MappingProxyType(
    {
        "prismatic": ("box", "pentagon", "l_bracket", "stairs"),
        "curved": (
            *("cylinder", "half_cylinder", "hollow_cylinder"),
            *("sphere", "torus", "vase", "pinched"),
        ),
        "organic": ("lumpy", "bean", "dumbbell"),
        "mixed": ("mallet", "rounded_box", "screw", "socket"),
        "thin": ("plate", "hook", "dish"),
    }
)
"""Names of the shapes that settings may be chosen on, by family."""

EVALUATION: Mapping[Family, tuple[str, ...]] = MappingProxyType(
    {
        "prismatic": (
            *("roof", "truncated_pyramid", "dodecahedron", "t_profile", "u_channel"),
            *("star_prism", "faceted_rock", "gear", "corner_cube"),
        ),
        "curved": (
            *("cone", "capsule", "lens", "bottle", "hourglass", "cut_ellipse", "dome"),
            *("stepped_shaft", "quarter_ring", "goblet", "saddle_block"),
        ),
        "organic": tuple(organic.EVALUATION),
        "mixed": (
            *("mug", "hammer", "pipe_tee", "fluted_knob", "kettlebell", "screwdriver"),
            *("drilled_block", "filleted_angle", "camera", "pillow_plate", "pulley"),
        ),
        "thin": (
            *("spoon", "angle_sheet", "bowl", "wrench", "bangle", "s_rod", "comb", "spatula"),
        ),
    }
)
"""Names of the shapes that nothing may be chosen on, by family."""

TOOLS = ("hammer", "screwdriver", "clamp", "plate", "ruler", "key", "spoon", "pen")
"""Names of tools and flat things, for lifts of long and low objects."""

LONG = (
    *("chisel", "paddle", "angle_bar", "tongs", "tapered_peg", "rasp", "rolling_pin", "hex_key"),
)
"""Names of long objects that the search for ends is reported on; nothing may be chosen on them."""

HARD = (
    *("washer", "coaster", "scissors", "table_knife", "fork", "saucer", "perforated_strip"),
    *("frying_pan", "hatchet", "jar_lid", "trowel", "ladle"),
)
"""Names of objects that are hard to hold, for lifts; nothing may be chosen on them."""

_FAMILY: Mapping[str, Family] = MappingProxyType(
    {
        name: family
        for shape_set in (DEVELOPMENT, EVALUATION)
        for family, names in shape_set.items()
        for name in names
    }
)

_ROOMS = ChainMap[str, Any](
    dict(organic.EVALUATION), *map(vars, (organic, simple, mixed, thin, hard))
)
_BUILDERS: Mapping[str, Callable[[], Solid]] = MappingProxyType(
    {name: _ROOMS[name] for name in (*_FAMILY, *TOOLS, *LONG, *HARD) if name not in BUILT_IN_SIZES}
)

GRASPABLE_SIZE = 0.1
"""Largest extent of test objects that a hand is to grasp, but for tools [m]."""

TEST_OBJECTS = tuple(sorted(_BUILDERS))
"""Names of all test objects that are not built into the package."""


@lru_cache(maxsize=8)
def graspable_shape(name: str, size: float | None = None) -> Shape:
    """Return one of `TEST_OBJECTS` in a size that a hand can grasp.

    `TOOLS`, `LONG` and `HARD` have their own size, others a largest extent of `GRASPABLE_SIZE`;
    `size` [m] replaces it.
    """
    shape = build_shape(name)
    if size is None:
        size = shape.size if name in (*TOOLS, *LONG, *HARD) else GRASPABLE_SIZE
    factor = size / shape.size
    mesh = shape.mesh.copy()
    mesh.apply_scale(factor)
    return Shape(name, mesh, factor * shape.edges)


def family_of(name: str) -> Family:
    """Return the family of a test object; that of a mesh file is "scans"."""
    return _FAMILY.get(name, "scans")


@lru_cache(maxsize=8)
def build_shape(name: str) -> Shape:
    """Return a test object by its name, or the object in a mesh file by its path.

    Raises `InvalidOptionError` if there is neither such an object nor such a file.
    """
    if name in BUILT_IN_SIZES:
        return shapes.build(name, BUILT_IN_SIZES[name])
    if name not in _BUILDERS:
        if Path(name).suffix:
            return shapes.load(name)
        raise InvalidOptionError.not_one_of("shape", name, tuple(_FAMILY))
    mesh = mesh_of(_BUILDERS[name]())
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    if family_of(name) == "organic":
        return Shape(name, mesh, np.empty((0, 2, 3)))
    return Shape(name, mesh, shapes.sharp_edges(mesh))


def scans_in(folder: Path) -> tuple[str, ...]:
    """Return the paths of the mesh files in a folder, sorted.

    Raises `InvalidFileError` if the folder has none.
    """
    found = sorted(str(p) for p in folder.glob("[!.]*") if p.suffix.lower() in shapes.FORMATS)
    if not found:
        raise InvalidFileError(
            f"{folder} must hold mesh files ({', '.join(shapes.FORMATS)}); it has none", path=folder
        )
    return tuple(found)
