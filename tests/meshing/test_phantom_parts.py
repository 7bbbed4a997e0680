"""Supported parts of a mesh are kept, phantom parts are dropped."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from analytic_surfaces import Analytic, Function, box, cube_bounds, difference, sphere, union
from mesh_laws import require_closed

from lis_grasp.meshing import extract_mesh

BOUNDS = cube_bounds(0.15)


def far_from(*centers: npt.ArrayLike) -> Function:
    """Return the distance of a point to the nearest touched place."""
    places = np.reshape(centers, (-1, 3))
    return lambda p: np.linalg.norm(p[..., None, :] - places, axis=-1).min(axis=-1)


def test_a_sheet_far_from_every_touch_is_dropped() -> None:
    two = union(sphere(0.05, [-0.07, 0.0, 0.0]), sphere(0.03, [0.09, 0.0, 0.0]))
    mesh = extract_mesh(Analytic(two, BOUNDS, far_from([-0.07, 0.0, 0.05])))
    require_closed(mesh)
    assert mesh.body_count == 1
    assert mesh.bounds[1, 0] < 0.0


def test_a_small_part_that_was_touched_stays() -> None:
    two = union(sphere(0.05, [-0.07, 0.0, 0.0]), sphere(0.03, [0.09, 0.0, 0.0]))
    touched = far_from([-0.07, 0.0, 0.05], [0.09, 0.0, 0.03])
    assert extract_mesh(Analytic(two, BOUNDS, touched)).body_count == 2
    assert extract_mesh(Analytic(two, BOUNDS)).body_count == 2  # both are equally uncertain


def test_a_crumb_that_no_contact_is_nearest_to_is_dropped_however_certain() -> None:
    two = union(sphere(0.05), sphere(0.012, [0.0, 0.0, 0.08]))
    contacts = 0.05 * np.vstack([np.eye(3), -np.eye(3)])
    assert extract_mesh(Analytic(two, BOUNDS)).body_count == 2
    mesh = extract_mesh(Analytic(two, BOUNDS), touched=contacts)
    require_closed(mesh)
    assert (mesh.body_count, mesh.metadata["dropped"]) == (1, 1)
    kept = extract_mesh(Analytic(two, BOUNDS), touched=[*contacts, [0.0, 0.0, 0.092]])
    assert (kept.body_count, kept.metadata["dropped"]) == (2, 0)


def test_a_phantom_shell_round_the_object_is_dropped() -> None:
    shell = difference(sphere(0.14), sphere(0.12))
    touched = far_from(*0.05 * np.vstack([np.eye(3), -np.eye(3)]))
    mesh = extract_mesh(Analytic(union(shell, sphere(0.05)), BOUNDS, touched))
    require_closed(mesh)
    assert mesh.bounds[1, 0] < 0.06


def test_a_touched_cavity_keeps_the_solid_round_it() -> None:
    hollow = difference(box(0.14), sphere(0.05))
    surface = Analytic(hollow, BOUNDS, far_from([0.0, 0.0, 0.05], [0.05, 0.0, 0.0]))
    mesh = extract_mesh(surface)
    require_closed(mesh)
    assert mesh.body_count == 2
    assert mesh.bounds[1, 0] == pytest.approx(0.14)


def test_an_untouched_cavity_is_filled() -> None:
    hollow = difference(sphere(0.14), sphere(0.03))
    touched = far_from(*0.14 * np.vstack([np.eye(3), -np.eye(3)]))
    mesh = extract_mesh(Analytic(hollow, BOUNDS, touched))
    require_closed(mesh)
    assert mesh.body_count == 1
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 0.14**3, rel=0.01)
