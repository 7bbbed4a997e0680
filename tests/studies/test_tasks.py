"""Tasks at edges: closed forms of slots, walls, cups and standing, and objects of a salt."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from lis_grasp import Hand
from lis_grasp_studies.evaluation.part import SaltedTrial
from lis_grasp_studies.evaluation.task_geometry import (
    FAILED,
    Surface,
    extent_bands,
    slot_clearance,
    standing,
    suction,
    surface_excess,
    wall_errors,
)
from lis_grasp_studies.evaluation.tasks import (
    COUNTS,
    HULL,
    TRUTH,
    measure_tasks,
    ratio_table,
    slot_ratio,
    tasks_table,
)
from lis_grasp_studies.test_objects.salted import FAMILIES, SIZES, salted_shape

SIDE = 0.06
CUP = Hand.load("cup").pads[0].cup
assert CUP is not None
BOX = trimesh.creation.box([SIDE] * 3)
NO_EDGES = np.empty((0, 3))


def resized(by: float) -> trimesh.Trimesh:
    """Return the box with each face moved out by a distance [m]."""
    return trimesh.creation.box([SIDE + 2.0 * by] * 3)


def on(mesh: trimesh.Trimesh) -> Surface:
    return Surface(mesh, 400, CUP, 0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slot_needs_what_the_outline_is_off(axis: int) -> None:
    """Off by d it needs sqrt(2) d: its joins are round, and corners decide.

    Too small, the box's corners are sqrt(2) d outside. Too large, the box moves towards a corner by
    2 c until c = sqrt(2) d.
    """
    assert slot_clearance(BOX, BOX, axis) < 1e-4
    assert slot_clearance(resized(0.003), BOX, axis) == pytest.approx(
        0.003 * np.sqrt(2.0), abs=1.5e-4
    )
    off = slot_clearance(resized(-0.002), BOX, axis)
    assert off == pytest.approx(0.002 * np.sqrt(2.0), abs=1e-4)  # joins are round


def test_a_slot_of_an_open_mesh_fits_nothing() -> None:
    open_box = trimesh.Trimesh(BOX.vertices, BOX.faces[:-1], process=False)
    assert slot_clearance(open_box, BOX, 2) == FAILED


def test_walls_are_off_by_the_difference_of_the_extents() -> None:
    yaws = np.array([0.0, 0.25 * np.pi])
    along = np.array([1.0, np.sqrt(2.0)])  # a corner of the box is ahead
    assert_allclose(wall_errors(resized(0.002), BOX, yaws), 0.002 * np.stack([along] * 2).T)


def test_a_cup_seals_on_a_face_and_not_over_an_edge() -> None:
    x = np.array([0.0, 0.5 * SIDE - CUP.radius - 1e-3, 0.5 * SIDE - CUP.radius + 2e-3])
    points = np.column_stack([x, 0.0 * x, np.full(3, 0.5 * SIDE)])
    sealed = on(BOX).seals(points, np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert sealed.tolist() == [True, True, False]


def test_a_cup_tilts_to_a_face_by_up_to_fifteen_degrees() -> None:
    angles = np.radians([8.0, 25.0])
    axes = np.column_stack([np.sin(angles), 0.0 * angles, np.cos(angles)])
    points = np.tile([0.0, 0.0, 0.5 * SIDE], (2, 1))
    assert on(BOX).seals(points, axes).tolist() == [True, False]


def test_of_the_true_surface_all_cups_are_accepted() -> None:
    counts = suction(on(BOX), on(BOX), NO_EDGES)
    assert counts["true"] == counts["accepted"] == counts["said"] == counts["kept"] > 100
    # A cup of radius r fits on (s - 2 r)^2 of each face; 400 samples, four standard errors.
    share = (1.0 - 2.0 * CUP.radius / SIDE) ** 2
    assert counts["true"] / 400 == pytest.approx(
        share, abs=4.0 * np.sqrt(share * (1 - share) / 400)
    )


def test_a_box_stands_on_what_a_box_says_and_not_on_a_rounded_one() -> None:
    assert standing(BOX, BOX) == {"found": 1.0, "stands": 1.0}
    pyramid = trimesh.convex.convex_hull(
        np.array(
            [[0.03, 0.03, 0], [-0.03, 0.03, 0], [-0.03, -0.03, 0], [0.03, -0.03, 0], [0, 0, 0.05]]
        )
    )
    assert standing(pyramid, BOX)["found"] < 0.5


def test_superfluous_surface_is_measured_outward() -> None:
    larger = surface_excess(on(resized(0.004)), on(BOX), NO_EDGES)
    assert larger["beyond"] >= 0.004
    assert larger["beyond_3mm"] == 1.0
    smaller = surface_excess(on(resized(-0.004)), on(BOX), NO_EDGES)
    assert smaller["beyond"] <= -0.004
    assert smaller["beyond_3mm"] == 0.0


def test_extents_are_inside_two_deviations() -> None:
    mesh = resized(0.003)
    mesh.vertex_attributes["uncertainty"] = np.full(8, 0.0016)
    assert extent_bands(mesh, BOX) == pytest.approx({"inside": 1.0, "band": 4 * 0.0016})
    mesh.vertex_attributes["uncertainty"] = np.full(8, 0.0014)
    assert extent_bands(mesh, BOX)["inside"] == 0.0
    assert extent_bands(BOX, BOX) == {}


@pytest.mark.parametrize("number", range(2 * len(FAMILIES)))
def test_an_object_of_a_salt_is_closed_and_fits_a_hand(number: int) -> None:
    shape, again = salted_shape("pepper", number), salted_shape("pepper", number)
    assert shape.mesh.is_watertight
    assert shape.mesh.body_count == 1
    assert SIZES[0] <= shape.mesh.extents.max() <= SIZES[1]
    assert shape.name.split("-")[0] == tuple(FAMILIES)[number % len(FAMILIES)]
    assert shape.mesh.vertices.tobytes() == again.mesh.vertices.tobytes()
    other = salted_shape("salt", number).mesh
    assert other.vertices.shape != shape.mesh.vertices.shape or not np.allclose(
        other.vertices, shape.mesh.vertices
    )


@pytest.mark.experiments
def test_rows_of_a_trial_make_the_tables() -> None:
    pytest.importorskip("statsmodels")
    rows = []
    for number in (0, 1):
        for name in (HULL, TRUTH):
            facts = {"salt": "pepper", "number": number, "seed": 0, "estimator": name}
            trial = SaltedTrial("pepper", number, 0)
            rows += [facts | row for row in measure_tasks(trial, name)]
    assert [row["count"] for row in rows[:2]] == list(COUNTS)
    assert all(row["slot"] < 1e-4 for row in rows if row["estimator"] == TRUTH)
    hull = [row["slot_x"] for row in rows if row["estimator"] == HULL]
    assert np.mean(hull) > 1e-3
    ratio = slot_ratio(rows, HULL, TRUTH, max(COUNTS))
    assert ratio is not None
    assert ratio.mean > 5.0
    assert ratio.objects == 2
    assert len(tasks_table(rows).body) == 4
    assert ratio_table(rows).body == ()  # neither estimator is compared
