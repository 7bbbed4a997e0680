"""Fuzzing cases of degenerate contacts: fit each estimator, evaluate it, and mesh some."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fuzzing.cases import Case, Kind, require
from lis_grasp import Contacts, extract_mesh
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface
from lis_grasp.typing import FloatArray

Generator = np.random.Generator

_MOST = 4000
_ENORMOUS = 100_000
_MESHED = 0.2  # fraction of cases
_CELLS = 14  # along the largest extent


def make(group: str, index: int, rng: Generator, folder: Path) -> Case:
    """Return contacts on a random shape with up to three faults, and options of the estimator."""
    if index < len(ESTIMATORS):
        return _enormous(group, rng)
    base = str(rng.choice(list(_BASES)))
    count = _count(rng, _MOST)
    points, normals = _BASES[base](rng, count)
    points *= 0.1
    described = [f"{len(points)} on a {base}"]
    sound = base in ("sphere", "box", "cylinder", "torus") and 6 <= count <= 1000
    if rng.random() < 0.25:
        factor = _scale(rng)
        points = points * factor
        described.append(f"times {factor:.3g}")
        sound &= 1e-3 < factor < 1e4
    if rng.random() < 0.2:
        offset = 10.0 ** rng.uniform(-2, 8 if rng.random() < 0.3 else 2)
        points = points + offset * rng.standard_normal(3)
        described.append(f"moved by {offset:.3g} m")
        sound &= offset < 1.0 and len(described) == 2
    faults = rng.choice(list(_FAULTS), size=rng.choice(4, p=[0.4, 0.35, 0.15, 0.1]))
    # "misshapen" comes last, since the other faults need arrays of numbers.
    for fault in sorted(faults, key=lambda fault: fault == "misshapen"):
        points, normals = _FAULTS[fault](rng, points, normals)
        described.append(str(fault))
        sound = False
    options = _options(rng)
    if options:
        described.append(str(options))
        sound = False
    meshed, seed = bool(rng.random() < _MESHED), int(rng.integers(2**32))

    def check() -> None:
        surface = ESTIMATORS[group](Contacts(points, normals), **options)
        asked = np.random.default_rng(seed)
        check_answers(surface, np.asarray(points, np.float64), asked)
        require(bool((surface.bounds[0] < surface.bounds[1]).all()), "bounds have a volume")
        if meshed:
            check_mesh(surface)

    return Case(f"{group} of contacts " + ", ".join(described), check, sound)


def _enormous(group: str, rng: Generator) -> Case:
    """Return 100 000 contacts."""
    contacts = Contacts(*_sphere(rng, _ENORMOUS))

    def check() -> None:
        check_answers(ESTIMATORS[group](contacts), contacts.points, rng)

    return Case(f"{group} of {_ENORMOUS} contacts on a sphere", check, True, limit=180.0)


def check_answers(surface: ImplicitSurface, points: FloatArray, rng: Generator) -> None:
    """Require finite values, gradients and uncertainties within the bounds and far outside."""
    bounds = surface.bounds
    require(bounds.shape == (2, 3) and bool(np.isfinite(bounds).all()), "bounds are finite")
    require(bool((bounds[0] <= bounds[1]).all()), "bounds are in order")
    low, high = bounds
    inside = low + rng.random((40, 3)) * (high - low)
    near = points[rng.integers(len(points), size=min(20, len(points)))]
    far = bounds.mean(axis=0) + 1e3 * (high - low) * rng.standard_normal((5, 3))
    asked = np.concatenate([inside, near, far])
    for name in ("evaluate", "gradient", "uncertainty"):
        answer = getattr(surface, name)(asked)
        shape = (len(asked), 3) if name == "gradient" else (len(asked),)
        require(answer.shape == shape, f"{name} has shape {shape}")
        require(bool(np.isfinite(answer).all()), f"{name} is finite")
        require(name != "uncertainty" or bool((answer >= 0.0).all()), "uncertainty is positive")


def check_mesh(surface: ImplicitSurface) -> None:
    """Require a closed, outward mesh of finite vertices within the bounds' grid."""
    bounds = surface.bounds
    cell = float(np.ptp(bounds, axis=0).max()) / _CELLS
    mesh = extract_mesh(surface, resolution=cell)
    require(bool(np.isfinite(mesh.vertices).all()), "vertices are finite")
    require(bool(mesh.is_watertight), "mesh is closed")
    require(bool(mesh.is_winding_consistent), "mesh is oriented")
    about_middle = mesh.triangles - mesh.vertices.mean(axis=0)
    require(bool(np.linalg.det(about_middle / cell).sum() > 0.0), "mesh looks outward")


def _count(rng: Generator, most: int) -> int:
    if rng.random() < 0.25:
        return int(rng.integers(6))
    largest = most if rng.random() < 0.03 else 120
    return int(10.0 ** rng.uniform(0.5, np.log10(largest)))


def _scale(rng: Generator) -> float:
    draw = rng.random()
    if draw < 0.4:
        return 1000.0  # millimetres given as metres
    exponent = 6.0 if draw < 0.7 else 20.0 if draw < 0.95 else 300.0
    return float(10.0 ** rng.uniform(-exponent, exponent))


def _options(rng: Generator) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for name, usual in (("position_noise", 1e-3), ("normal_noise", 0.05)):
        draw = rng.random()
        if draw < 0.2:
            options[name] = float(usual * 10.0 ** rng.uniform(-1, 1))
        elif draw < 0.26:
            unusual = [0.0, 1e-12, 1e-300, 1.0, 1e3, 1e300, -1.0, np.nan, np.inf]
            options[name] = unusual[rng.integers(len(unusual))]
    return options


# Shapes about 1 across, each (points, normals).
_Surface = tuple[FloatArray, FloatArray]


def _sphere(rng: Generator, count: int) -> _Surface:
    normals = _units(rng.standard_normal((count, 3)))
    return 0.5 * normals, normals


def _box(rng: Generator, count: int) -> _Surface:
    normals = np.eye(3)[np.arange(count) % 3] * (1 - 2 * (np.arange(count) // 3 % 2))[:, None]
    points = rng.uniform(-0.5, 0.5, (count, 3))
    return np.where(normals != 0.0, 0.5 * normals, points), normals


def _cylinder(rng: Generator, count: int) -> _Surface:
    points = _units(rng.standard_normal((count, 3)))
    cap = np.abs(points[:, 2]) > 0.7
    across = points[:, :2]
    radial = across / np.linalg.norm(across, axis=1, keepdims=True)
    normals = np.column_stack([radial, np.zeros(count)])
    normals[cap] = np.sign(points[cap, 2:]) * [0.0, 0.0, 1.0]
    sides = np.column_stack([0.3 * radial, 0.5 * points[:, 2] / 0.7])
    caps = np.column_stack([0.4 * across, 0.5 * np.sign(points[:, 2])])
    return np.where(cap[:, None], caps, sides), normals


def _torus(rng: Generator, count: int) -> _Surface:
    u, v = rng.uniform(0, 2 * np.pi, (2, count))
    ring = np.column_stack([np.cos(u), np.sin(u), np.zeros(count)])
    normals = np.cos(v)[:, None] * ring + np.sin(v)[:, None] * [0.0, 0.0, 1.0]
    return 0.35 * ring + 0.15 * normals, normals


def _plane(rng: Generator, count: int) -> _Surface:
    normal = _units(rng.standard_normal((1, 3)))
    points = rng.standard_normal((count, 3))
    return points - (points @ normal.T) * normal, np.repeat(normal, count, axis=0)


def _line(rng: Generator, count: int) -> _Surface:
    along = _units(rng.standard_normal((1, 3)))
    across = _units(np.cross(along, rng.standard_normal((1, 3))))
    return rng.standard_normal((count, 1)) * along, np.repeat(across, count, axis=0)


def _plate(rng: Generator, count: int) -> _Surface:
    points, sides = rng.uniform(-0.5, 0.5, (count, 3)), rng.choice([-1.0, 1.0], count)
    points[:, 2] = 10.0 ** rng.uniform(-8, -1) * sides
    return points, np.column_stack([np.zeros((count, 2)), sides])


def _spot(rng: Generator, count: int) -> _Surface:
    return np.zeros((count, 3)) + rng.standard_normal(3), _units(rng.standard_normal((count, 3)))


def _grid(rng: Generator, count: int) -> _Surface:
    points = rng.integers(-2, 3, (count, 3)) / 4.0
    return points, np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1.0, 1.0], (count, 1))


def _cloud(rng: Generator, count: int) -> _Surface:
    return rng.standard_normal((count, 3)), _units(rng.standard_normal((count, 3)))


_BASES: dict[str, Callable[[Generator, int], _Surface]] = {
    "sphere": _sphere,
    "box": _box,
    "cylinder": _cylinder,
    "torus": _torus,
    "plane": _plane,
    "line": _line,
    "plate": _plate,
    "spot": _spot,
    "grid": _grid,
    "cloud": _cloud,
}


def _units(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _some(rng: Generator, rows: FloatArray) -> npt.NDArray[np.intp]:
    """Return some row numbers, at least one if there are rows."""
    if not len(rows):
        return np.empty(0, np.intp)
    return rng.integers(len(rows), size=max(1, int(len(rows) * rng.uniform(0, 0.5))))


def _duplicated(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    again = _some(rng, points)
    return np.vstack([points, points[again]]), np.vstack([normals, normals[again]])


def _contradicted(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    """Add contacts close to some others, with another normal."""
    again = _some(rng, points)
    size = float(np.abs(points).max(initial=0.0))
    hair = size * 10.0 ** rng.uniform(-15, -2) * rng.standard_normal((len(again), 3))
    random = _units(rng.standard_normal((len(again), 3)))
    other = -normals[again] if rng.random() < 0.5 else random
    return np.vstack([points, points[again] + hair]), np.vstack([normals, other])


def _inward(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    turned = normals.copy()
    turned[slice(None) if rng.random() < 0.5 else _some(rng, points)] *= -1.0
    return points, turned


def _random_normals(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    return points, _units(normals + rng.uniform(0, 2) * rng.standard_normal(normals.shape))


def _jitter(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return points + size * 10.0 ** rng.uniform(-12, 0) * rng.standard_normal(points.shape), normals


def _flattened(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    factors = np.ones(3)
    factors[rng.integers(3)] = rng.choice([0.0, 1e-12, 1e-6, 1e-3])
    return points * factors, normals


def _clustered(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    """Move most contacts close together."""
    drawn = rng.random((len(points), 1)) < 0.8
    return np.where(drawn, points * 10.0 ** rng.uniform(-12, -1), points), normals


def _spoiled_numbers(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    spoiled = (points.copy(), normals.copy())
    value = rng.choice([np.nan, np.inf, -np.inf, 1e308, 0.0, -0.0, 5e-324])
    spoiled[rng.integers(2)][_some(rng, points), rng.integers(3)] = value
    return spoiled


def _lengthened(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    """Scale normals: to zero, by a few per cent, or by much."""
    factors = np.ones((len(normals), 1))
    factors[_some(rng, points)] = rng.choice([0.0, 1e-300, 0.995, 1.2, 2.0, 1e200])
    return points, normals * factors


def _misshapen(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    """Change the shape or the type of the arrays."""
    if np.ndim(points) != 2 or np.ndim(normals) != 2:
        return points, normals
    forms = [
        (points[:, :2], normals),
        (points, normals[:-1]),
        (points.ravel(), normals.ravel()),
        (points[None], normals[None]),
        (points.astype(str), normals),
        (points.astype(complex) + 1j, normals),
        (points, normals.astype(object)),
    ]
    return forms[rng.integers(len(forms))]


def _low_precision(rng: Generator, points: FloatArray, normals: FloatArray) -> _Surface:
    with np.errstate(over="ignore"):
        return points.astype(np.float32), normals.astype(np.float32)


_FAULTS: dict[str, Callable[[Generator, FloatArray, FloatArray], _Surface]] = {
    "duplicated": _duplicated,
    "contradicted": _contradicted,
    "inward": _inward,
    "random normals": _random_normals,
    "jitter": _jitter,
    "flattened": _flattened,
    "clustered": _clustered,
    "spoiled numbers": _spoiled_numbers,
    "normals of other length": _lengthened,
    "misshapen": _misshapen,
    "low precision": _low_precision,
}

KIND = Kind(tuple(ESTIMATORS), make)
