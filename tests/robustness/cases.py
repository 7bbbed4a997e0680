"""Tests of malformed input by kind, for pytest and for the coverage-guided fuzzer.

The environment variable ROBUSTNESS multiplies the number of cases, and draws new ones each time;
kills are drawn from ROBUSTNESS_SEED.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from shutil import copytree, rmtree
from tempfile import TemporaryDirectory, mkdtemp

import numpy as np
from damage import damaged
from degenerate import contact_inputs, mesh_inputs, write_mesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from readers import READERS, check_shape, refused_at_most

from lis_grasp import Contacts, extract_mesh, shapes
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface

TIMES = int(os.environ.get("ROBUSTNESS", "1"))
SEED = int(os.environ.get("ROBUSTNESS_SEED", "5"))
_CELLS = 14  # of a mesh along the largest extent


def cases(count: int) -> settings:
    """Return settings of a test that takes `count` cases."""
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example]
    return settings(
        max_examples=count * TIMES,
        deadline=None,
        derandomize=TIMES == 1,
        database=None,
        suppress_health_check=checks,
    )


def damaged_file(kind: str, count: int = 4) -> Callable[[], None]:
    """Return a test of one reader: each damaged file is read, or refused in a sentence."""
    reader, valid = READERS[kind], Path(mkdtemp(prefix="valid-"))
    atexit.register(rmtree, valid)
    file = reader.write(valid)
    whole = file.read_bytes()

    @cases(count)
    @given(data=st.data())
    def test(data: st.DataObject) -> None:
        with TemporaryDirectory(prefix="case-") as name:
            folder = copytree(valid, Path(name) / "files")
            path = folder / file.name
            path.write_bytes(data.draw(damaged(whole, path.suffix)))
            with refused_at_most():
                reader.check(path)

    return test


def damaged_mesh(ending: str, count: int = 4) -> Callable[[], None]:
    """Return a test of meshes with faults: each is repaired to a solid, or refused."""

    @cases(count)
    @given(mesh=mesh_inputs(), units=st.sampled_from(["m", "m", "m", *shapes.UNITS, "furlong"]))
    def test(mesh: tuple[np.ndarray, np.ndarray], units: str) -> None:
        with TemporaryDirectory(prefix="case-") as folder:
            path = Path(folder) / f"mesh.{ending}"
            path.write_bytes(write_mesh(ending, *mesh))
            with refused_at_most(), np.errstate(over="ignore"):
                given_vertices = mesh[0] * shapes.UNITS.get(units, 1.0)
                check_shape(shapes.load(path, units), given_vertices)

    return test


def degenerate_contacts(estimator: str, count: int = 8) -> Callable[[], None]:
    """Return a test of an estimator: it answers with finite numbers, or refuses the contacts."""

    @cases(count)
    @given(contacts=contact_inputs(), meshed=st.sampled_from([True, *[False] * 4]))
    def test(contacts: tuple, meshed: bool) -> None:
        points, normals, options = contacts
        with refused_at_most(30.0):
            surface = ESTIMATORS[estimator](Contacts(points, normals), **options)
            check_answers(surface, np.asarray(points, np.float64))
            assert (surface.bounds[0] < surface.bounds[1]).all()
            if meshed:
                _check_mesh(surface)

    return test


def check_answers(surface: ImplicitSurface, points: np.ndarray) -> None:
    """Require finite values, gradients and uncertainties within the bounds and far outside."""
    rng = np.random.default_rng(0)
    low, high = surface.bounds
    assert np.isfinite([low, high]).all()
    assert (low <= high).all()
    inside = low + rng.random((40, 3)) * (high - low)
    near = points[rng.integers(len(points), size=min(20, len(points)))]
    far = 0.5 * (low + high) + 1e3 * (high - low) * rng.standard_normal((5, 3))
    queries = np.concatenate([inside, near, far])
    for answer in (surface.evaluate(queries), surface.uncertainty(queries)):
        assert answer.shape == (len(queries),)
        assert np.isfinite(answer).all()
    assert (answer >= 0.0).all()
    gradient = surface.gradient(queries)
    assert gradient.shape == queries.shape
    assert np.isfinite(gradient).all()


def _check_mesh(surface: ImplicitSurface) -> None:
    cell = float(np.ptp(surface.bounds, axis=0).max()) / _CELLS
    mesh = extract_mesh(surface, resolution=cell)
    assert np.isfinite(mesh.vertices).all()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert np.linalg.det((mesh.triangles - mesh.vertices.mean(axis=0)) / cell).sum() > 0.0


MESH_FORMATS = ("obj", "off", "ply", "stl")
TESTS: dict[str, Callable[..., Callable[[], None]]] = {
    **{kind: partial(damaged_file, kind) for kind in READERS},
    **{f"faults {f}": partial(damaged_mesh, f) for f in MESH_FORMATS},
    **{f"contacts {name}": partial(degenerate_contacts, name) for name in ESTIMATORS},
}
"""Makers of the tests, by kind; `count` is their number of cases."""
