"""Doses of missing edges and superfluous surface: closed forms, pairs, equality, one part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes.mesh_distance import InsideTest, MeshTree
from lis_grasp_studies.evaluation.configuration import Configuration
from lis_grasp_studies.evaluation.dose import (
    CONTINUED,
    EXACT,
    ROUNDED,
    TOO_THIN,
    DosePart,
    changed_truth,
    differences,
)
from lis_grasp_studies.evaluation.part import Places
from lis_grasp_studies.evaluation.results import Evaluation, EvaluationResults
from lis_grasp_studies.harness.runner import InProcess
from lis_grasp_studies.test_objects.changed_edges import (
    PLATE,
    ROUND_SEGMENTS,
    continue_faces,
    round_edges,
)
from lis_grasp_studies.test_objects.salted import EDGED_FAMILIES
from lis_grasp_studies.test_objects.solid_modelling import Solid, block, mesh_of

SIDES = np.array([0.04, 0.05, 0.06])
FACES = SIDES[[[0, 1], [1, 2], [2, 0]]]  # sides of three faces, (3, 2)
BOX = trimesh.creation.box(SIDES)
MILLIMETRES = (2, 4, 8)

# Area of a circle of radius 1 with as many sides as the doses'.
CIRCLE = 0.5 * ROUND_SEGMENTS * np.sin(2.0 * np.pi / ROUND_SEGMENTS)
# By how much of the radius such a ball is smaller: two steps between its corners meet at a facet.
CHORD = 1.0 - np.cos(2.0 * np.pi / ROUND_SEGMENTS)


def turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh at a general rotation."""
    return mesh.copy().apply_transform(
        trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.7, 0.1]))
    )


@pytest.mark.parametrize("millimetres", MILLIMETRES)
def test_the_volume_of_a_rounded_box_is_that_of_steiner_s_formula(millimetres: int) -> None:
    """The inner box grows by a ball: prisms on its faces, sectors along its edges, and the ball."""
    radius = 1e-3 * millimetres
    inner = SIDES - 2.0 * radius
    prisms = 2.0 * radius * (FACES - 2.0 * radius).prod(axis=1).sum()
    ball = Solid.sphere(radius, ROUND_SEGMENTS).volume()
    expected = inner.prod() + prisms + CIRCLE * radius**2 * inner.sum() + ball
    rounded = round_edges(BOX, radius)
    assert rounded is not None
    assert rounded.is_watertight
    assert rounded.volume == pytest.approx(expected, rel=1e-9)
    assert_allclose(rounded.bounds, BOX.bounds, atol=1e-9)  # flat faces stay


@pytest.mark.parametrize("millimetres", MILLIMETRES)
@pytest.mark.parametrize("box", [BOX, turned(BOX)], ids=["upright", "turned"])
def test_edges_and_corners_of_a_rounded_box_are_as_far_away_as_those_of_a_ball(
    box: trimesh.Trimesh, millimetres: int
) -> None:
    radius = 1e-3 * millimetres
    rounded = round_edges(box, radius)
    assert rounded is not None
    tree, allowed = MeshTree(rounded), CHORD * radius + 2e-5
    corners = np.sqrt(tree.nearest(box.vertices)[0])
    sharp = box.face_adjacency_angles > 1.0
    middles = box.vertices[box.face_adjacency_edges[sharp]].mean(axis=1)
    edges = np.sqrt(tree.nearest(middles)[0])
    assert_allclose(corners, (np.sqrt(3.0) - 1.0) * radius, atol=allowed)
    assert_allclose(edges, (np.sqrt(2.0) - 1.0) * radius, atol=allowed)
    assert MeshTree(box).nearest(rounded.vertices)[0].max() < (radius + allowed) ** 2
    outside = trimesh.proximity.signed_distance(box, rounded.vertices) < -4e-5
    assert not outside.any()


def test_a_concave_edge_stays_and_convex_ones_are_rounded() -> None:
    bracket = mesh_of(block(0.06, 0.04, 0.02) + block(0.02, 0.04, 0.08).translate((-0.02, 0, 0.03)))
    rounded = round_edges(bracket, 0.004)
    assert rounded is not None
    concave, convex = [-0.01, 0.0, 0.01], [0.03, 0.0, 0.01]
    gaps = np.sqrt(MeshTree(rounded).nearest(np.array([concave, convex]))[0])
    assert gaps[0] < 4e-5
    assert gaps[1] == pytest.approx(0.004 * (np.sqrt(2.0) - 1.0), abs=0.004 * CHORD + 2e-5)


def test_what_is_too_thin_is_not_rounded() -> None:
    plate = block(0.06, 0.05, 0.003)
    bar = block(0.1, 0.003, 0.003)
    ends = [block(0.03, 0.03, 0.03).translate((x, 0.0, 0.0)) for x in (-0.05, 0.05)]
    wall = block(0.06, 0.004, 0.05).translate((0.0, 0.0, 0.03))
    assert round_edges(mesh_of(plate), 0.002) is None  # nothing is left
    assert round_edges(mesh_of(bar + ends[0] + ends[1]), 0.002) is None  # two pieces are left
    # The wall is a quarter of the volume.
    assert round_edges(mesh_of(block(0.06, 0.06, 0.01) + wall), 0.004) is None


@pytest.mark.parametrize("millimetres", MILLIMETRES)
@pytest.mark.parametrize("box", [BOX, turned(BOX)], ids=["upright", "turned"])
def test_the_volume_of_continued_faces_of_a_box_is_that_counted(
    box: trimesh.Trimesh, millimetres: int
) -> None:
    """Each face gains strips along its edges and sectors at its corners, as deep as a plate.

    At each of eight corners, plates of each two of its faces cross beyond the third: 24 blocks are
    counted twice.
    """
    reach = 1e-3 * millimetres
    rings = 2.0 * reach * FACES.sum(axis=1) + CIRCLE * reach**2
    expected = SIDES.prod() + 2.0 * PLATE * rings.sum() - 24.0 * PLATE**2 * reach
    continued = continue_faces(box, reach)
    assert continued.is_watertight
    assert continued.volume == pytest.approx(expected, rel=1e-6)
    assert np.sqrt(MeshTree(box).nearest(continued.vertices)[0]).max() == pytest.approx(
        reach, abs=2e-5
    )
    assert InsideTest(continued).inside(0.999 * box.vertices).all()  # nothing is taken away


def test_faces_are_continued_in_their_planes_and_not_below_the_table() -> None:
    reach = 0.004
    continued = continue_faces(BOX, reach)
    assert_allclose(continued.bounds, BOX.bounds + reach * np.array([[-1.0], [1.0]]), atol=2e-5)
    x, y, z = 0.5 * SIDES
    above = np.array([0.0, 0.0, 1e-4])
    beyond = np.array([[x + 0.003, 0.0, z], [0.0, y + 0.003, z], [x + 0.002, y + 0.002, z]])
    assert InsideTest(continued).inside(beyond - above).all()
    assert not InsideTest(continued).inside(beyond + above).any()
    assert not InsideTest(continued).inside(beyond - [0.0, 0.0, PLATE + 1e-4]).any()
    cut = continue_faces(BOX, reach, lowest=-z)
    assert cut.bounds[0, 2] == pytest.approx(-z, abs=1e-9)


def test_a_face_does_not_continue_beyond_a_concave_edge() -> None:
    """The sides of a wall on a slab, continued by 30 mm, would come out below the slab."""
    slab, wall = block(0.08, 0.04, 0.02), block(0.004, 0.04, 0.04).translate((0.0, 0.0, 0.03))
    continued = continue_faces(mesh_of(slab + wall), 0.03)
    x, below = 0.002 - 0.5 * PLATE, -0.012
    assert not InsideTest(continued).inside(np.array([[x, 0.0, below], [-x, 0.0, below]])).any()
    ends = 0.04 - 0.5 * PLATE  # those of the slab's ends are there
    assert InsideTest(continued).inside(np.array([[ends, 0.0, below], [-ends, 0.0, below]])).all()


def test_each_dose_of_each_family_is_one_solid_above_the_table() -> None:
    for number in range(len(EDGED_FAMILIES) - 1):  # all but the turned one, which takes longest
        exact = changed_truth("pepper", number, 0, EXACT)
        for dose, sign in ((f"{ROUNDED} by 2 mm", -1.0), (f"{CONTINUED} by 2 mm", 1.0)):
            mesh = changed_truth("pepper", number, 0, dose)
            assert exact is not None
            assert mesh is not None
            assert mesh.is_watertight
            assert mesh.body_count == 1
            assert sign * (mesh.volume - exact.volume) > 0.0
            assert mesh.bounds[0, 2] > -2e-5  # above it, where what it rests on is rounded off


def test_an_unknown_dose_is_named() -> None:
    for dose in ("thickened by 2 mm", "rounded by two mm", "rounded"):
        with pytest.raises(InvalidOptionError) as error:
            changed_truth("pepper", 0, 0, dose)
        assert error.value.value == dose


def lifts(held: dict[str, list[int | None]]) -> list[Row]:
    """Return a row for each dose and object, with one hand; None is too thin."""
    facts: Row = {"hand": "wsg50", "seed": 0, "planned": 5, "close": 4, "edge_distance": 0.01}
    return [
        {"dose": dose, "number": k, "object": f"box-{k}"}
        | ({"reason": TOO_THIN, "hand": "wsg50", "seed": 0} if value is None else facts)
        | ({} if value is None else {"held": value, "reason": "held" if value else "dropped"})
        for dose, values in held.items()
        for k, value in enumerate(values)
    ]


def test_differences_are_those_counted_by_hand() -> None:
    # Continued by 2 loses four of twelve, by 4 eight of twelve; rounded by 8 has eleven objects.
    rows = lifts(
        {
            EXACT: [1] * 12,
            "continued by 2 mm": [0] * 4 + [1] * 8,
            "continued by 4 mm": [0] * 8 + [1] * 4,
            "rounded by 8 mm": [None] + [1] * 11,
        }
    )
    found = differences(rows)
    assert list(found) == [
        CONTINUED,
        ROUNDED,
        "continued by 2 mm",
        "continued by 4 mm",
        "rounded by 8 mm",
    ]
    both = found[CONTINUED]
    assert (both.lost, both.won, both.pairs, both.objects) == (12, 0, 24, 12)
    assert both.mean == pytest.approx(-0.5)
    assert found["rounded by 8 mm"].objects == 11
    # Eight objects lose, none wins: the exact sign flip; the four others are adjusted.
    assert both.p_value == pytest.approx(2.0 * 0.5**8)
    assert found["continued by 4 mm"].p_value == pytest.approx(4.0 * 2.0 * 0.5**8)
    part = DosePart(
        measure="dose", title="", variants=[EXACT], seconds=1.0, seeds=[0], salt="a", objects=6,
        hands=["wsg50"],
    )  # fmt: skip
    first, second = part.tables(rows)
    assert [line[0] for line in first.body][:2] == ["continued by 4 mm", f"{CONTINUED} (primary)"]
    thin = {line[0]: line[3] for line in second.body}
    assert thin["rounded by 8 mm"] == "1"
    assert thin[EXACT] == "0"
    assert [line[4] for line in second.body] == ["80"] * 4
    numbers = part.numbers(rows)
    assert numbers[f"points {CONTINUED}"] == pytest.approx(-50.0)
    assert numbers[f"pairs {ROUNDED}"] == 11
    assert (numbers[f"lost {CONTINUED}"], numbers[f"won {CONTINUED}"]) == (12, 0)
    assert not part.tables([])[0].body
    assert not part.answers([])


@pytest.mark.slow
def test_an_interrupted_part_ends_with_the_rows_of_an_undisturbed_one(tmp_path: Path) -> None:
    doses = [EXACT, f"{ROUNDED} by 8 mm", f"{CONTINUED} by 2 mm"]
    part = DosePart(
        measure="dose", title="", variants=doses, seconds=1.0, seeds=[0], salt="pepper",
        objects=6, hands=["wsg50"],
    )  # fmt: skip
    chosen = part.model_copy(update={"objects": 2})
    known = Configuration.model_construct(parts={"dose": chosen})

    def rows(folder: Path, stop: int = 99) -> list[Row]:
        steps = Evaluation(known, Places(), EvaluationResults(folder), InProcess()).run()
        for done, _, _ in steps:
            if done == stop:
                break
        found = EvaluationResults(folder).read()
        return [{k: v for k, v in r.items() if k not in ("job_seconds", "commit")} for r in found]

    assert len(rows(tmp_path / "stopped", stop=1)) == 3
    whole = rows(tmp_path / "whole")
    assert rows(tmp_path / "stopped") == whole
    assert [row["dose"] for row in whole] == 2 * doses
    assert all(row["held"] for row in whole)  # a prism and a frustum hold whatever is planned on
    assert all(row["close"] == row["planned"] == 5 for row in whole)
    assert all(0.0 < row["edge_distance"] < 0.05 for row in whole)
