"""Underflow: estimates, meshes and plans are the same in a program that lets NumPy raise."""

from __future__ import annotations

import numpy as np
import pytest

import lis_grasp
from lis_grasp import Contacts, estimate
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.underflow import methods_underflow, underflows

# Of a bar, whose ends are many spacings apart: kernels between them are 0 in floating point.
_X, _FACE = np.meshgrid(np.linspace(0.0, 0.2, 9), range(4))
_NORMALS = np.array([[0.0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0]])[_FACE.ravel()]
BAR = Contacts(_X.ravel()[:, None] * [1.0, 0.0, 0.0] + 0.01 * _NORMALS, _NORMALS)
POINTS = np.random.default_rng(0).uniform(-0.3, 0.5, (200, 3))


@pytest.mark.by_default("lis", "gpis")
@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_a_program_that_raises_gets_the_same_estimate(name: str) -> None:
    values = []
    for settings in ({}, {"under": "raise"}, {"all": "raise"}):
        with np.errstate(**settings):
            surface = estimate(BAR, name)
            values.append([surface.evaluate(POINTS), surface.gradient(POINTS)])
            values[-1].append(surface.uncertainty(POINTS[:20]))
    for other in values[1:]:
        for mine, theirs in zip(values[0], other, strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_a_programs_own_settings_are_kept_and_only_underflow_passes() -> None:
    @underflows
    def square(x: float) -> np.floating:
        return np.float64(x) * np.float64(x)

    @methods_underflow
    class Squares:
        def of(self, x: float) -> np.floating:
            return np.float64(x) * np.float64(x)

        @classmethod
        def made(cls, x: float) -> np.floating:
            return np.float64(x) * np.float64(x)

    with np.errstate(all="raise"):
        for each in (square, Squares().of, Squares.made):
            assert each(1e-300) == 0.0
            with pytest.raises(FloatingPointError):
                each(1e300)
        with pytest.raises(FloatingPointError):
            np.float64(1e-300) * np.float64(1e-300)


@pytest.mark.slow
def test_a_whole_run_is_the_same_in_a_program_that_raises() -> None:
    runs = []
    for settings in ({}, {"all": "raise"}):
        with np.errstate(**settings):
            run = lis_grasp.run("box", "wsg50", prober="kinematic", touches=12, attempts=1)
            runs.append((run.contacts.points, run.grasps[0].X_OH))
            mesh = extract_mesh(estimate(run.contacts))
            runs[-1] += (mesh.vertices, lis_grasp.surface_error(mesh, mesh).rmsd)
    for mine, theirs in zip(*runs, strict=True):
        np.testing.assert_array_equal(mine, theirs)
