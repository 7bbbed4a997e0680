"""Verdicts on contacts that lie: the cases of real files, laws, and sound contacts left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    EstimationError,
    InvalidContactsError,
    TooManyBadContactsError,
)
from lis_grasp.geometry import unit
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    judge_contacts,
    load_contacts,
    orient_normals,
)
from lis_grasp.surfaces._contact_evidence import Evidence
from lis_grasp_studies.contact_study.contact_sets import ContactCase, contact_set

BOX = trimesh.creation.box(extents=[0.06, 0.05, 0.04])
CYLINDER = trimesh.creation.cylinder(radius=0.025, height=0.08, sections=64)


def touched(mesh: trimesh.Trimesh, count: int) -> Contacts:
    """Contacts spread evenly over a mesh."""
    points, faces = trimesh.sample.sample_surface_even(mesh, count, seed=1)
    return Contacts(points, mesh.face_normals[faces])


def flipped(contacts: Contacts, fraction: float) -> tuple[Contacts, np.ndarray]:
    """Contacts of which a random fraction of normals has the wrong side, and which these are."""
    rng = np.random.default_rng(0)
    wrong = rng.random(len(contacts)) < fraction
    signs = np.where(wrong, -1.0, 1.0)[:, None]
    return replace(contacts, normals=signs * contacts.normals), wrong


def with_row(contacts: Contacts, row: int, point: list[float], normal: list[float]) -> Contacts:
    """Contacts with one more at a row."""
    points = np.insert(contacts.points, row, point, axis=0)
    return Contacts(points, np.insert(contacts.normals, row, normal, axis=0))


def extents(contacts: Contacts) -> np.ndarray:
    """Extents of the blended estimate [mm], which must be one body."""
    mesh = extract_mesh(BlendedImplicitSurface.from_contacts(contacts))
    assert mesh.body_count == 1
    return 1e3 * mesh.extents


@pytest.mark.slow
@pytest.mark.parametrize("rows", [[7], [0, 1, 2]])
def test_a_box_with_flipped_normals_has_its_true_size(rows: list[int]) -> None:
    contacts = touched(BOX, 60)
    normals = contacts.normals.copy()
    normals[rows] *= -1.0
    wrong = replace(contacts, normals=normals)
    assert judge_contacts(wrong).rows("flipped").tolist() == rows
    np.testing.assert_allclose(extents(wrong), [60.0, 50.0, 40.0], atol=0.1)
    assert np.abs(extents(replace(wrong, judged=True)) - [60.0, 50.0, 40.0]).max() > 1.0


@pytest.mark.by_default("mesh3-60-0.2-size3")
@pytest.mark.parametrize(
    ("mesh", "count", "fraction", "size"),
    [
        pytest.param(BOX, 60, 0.05, [60.0, 50.0, 40.0], marks=pytest.mark.slow),
        (BOX, 60, 0.2, [60.0, 50.0, 40.0]),
        pytest.param(BOX, 400, 0.05, [60.0, 50.0, 40.0], marks=pytest.mark.slow),
        (CYLINDER, 60, 0.2, [50.0, 50.0, 80.0]),
    ],
)
def test_normals_of_which_some_are_flipped_are_put_right(
    mesh: trimesh.Trimesh, count: int, fraction: float, size: list[float]
) -> None:
    wrong, which = flipped(touched(mesh, count), fraction)
    np.testing.assert_array_equal(judge_contacts(wrong).bad, which)
    np.testing.assert_allclose(extents(wrong), size, atol=0.3)  # the cylinder has 64 sides


@pytest.mark.parametrize("fraction", [0.35, 0.5])
@pytest.mark.parametrize("mesh", [BOX, CYLINDER])
def test_normals_of_which_many_are_flipped_are_refused_or_oriented(
    mesh: trimesh.Trimesh, fraction: float
) -> None:
    contacts = touched(mesh, 60)
    wrong, _ = flipped(contacts, fraction)
    with pytest.raises(TooManyBadContactsError) as error:
        BlendedImplicitSurface.from_contacts(wrong)
    assert error.value.count == 60
    np.testing.assert_array_equal(orient_normals(wrong).normals, contacts.normals)
    far = orient_normals(wrong, viewpoint=contacts.points + contacts.normals)
    np.testing.assert_array_equal(far.normals, contacts.normals)


@pytest.mark.parametrize("offset", [[0.4, 0.1, 0.3], [0.0, 0.0, 0.0]])
def test_an_empty_row_is_left_out(offset: list[float]) -> None:
    contacts = touched(BOX, 40)
    contacts = replace(contacts, points=contacts.points + offset)
    logged = with_row(contacts, 0, [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    verdicts = judge_contacts(logged)
    assert verdicts.rows("stray").tolist() == [0]
    np.testing.assert_array_equal(verdicts.credible.points, contacts.points)
    surface = GaussianProcessImplicitSurface.from_contacts(logged)
    same = GaussianProcessImplicitSurface.from_contacts(contacts)
    np.testing.assert_array_equal(surface.evaluate(contacts.points), same.evaluate(contacts.points))


def test_a_camera_s_empty_points_are_left_out() -> None:
    points, faces = trimesh.sample.sample_surface(BOX, 900, seed=1)
    rng = np.random.default_rng(0)
    points = points + rng.normal(0.0, 0.0005, points.shape) + [0.4, 0.1, 0.3]
    empty = rng.random(len(points)) < 0.1
    points[empty] = 0.0
    verdicts = judge_contacts(Contacts(points, BOX.face_normals[faces]))
    np.testing.assert_array_equal(verdicts.codes > 0, empty)  # repeated rows share a verdict


def test_signs_that_one_flat_side_does_not_show_are_not_guessed() -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-0.03, 0.03, (40, 2)), np.zeros(40)])
    normals = np.tile([0.0, 0.0, 1.0], (40, 1))
    with pytest.raises(EstimationError, match="viewpoint"):
        orient_normals(Contacts(points, normals))


@pytest.mark.by_default("plate-case0", "socket-case2", "stairs-case4")
@pytest.mark.parametrize(
    ("shape", "case"),
    [
        ("plate", ContactCase("even", 40)),
        ("hollow_cylinder", ContactCase("even", 40)),
        ("socket", ContactCase("random", 100)),
        pytest.param("screw", ContactCase("clustered", 60), marks=pytest.mark.slow),
        ("stairs", ContactCase("half", 30)),
        pytest.param("hook", ContactCase("even", 60, level=2), marks=pytest.mark.slow),
        ("vase", ContactCase("even", 10)),
    ],
)
def test_sound_contacts_of_thin_and_deep_shapes_are_believed(shape: str, case: ContactCase) -> None:
    contacts = contact_set(shape, case, seed=5).contacts
    verdicts = judge_contacts(contacts)
    assert not verdicts.bad.any()
    assert verdicts.sentence() == ""


@pytest.mark.parametrize("surface", ["ball", "cylinder", "plate"])
def test_chords_of_balls_cylinders_and_plates_favour_the_true_signs(surface: str) -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-1.0, 1.0, (30, 3)) * [0.05, 0.05, 0.03]
    if surface == "plate":
        normals = np.tile([0.0, 0.0, 1.0], (30, 1))
        normals[15:] *= -1.0
        points[:, 2] = 0.001 * normals[:, 2]
    else:
        normals = unit(points * ([1.0, 1.0, 1.0] if surface == "ball" else [1.0, 1.0, 0.0]))
        points = 0.03 * normals + (points * [0.0, 0.0, 1.0] if surface == "cylinder" else 0.0)
    evidence = Evidence.of(Contacts(points, normals), np.zeros(30), np.zeros(30))
    chords = evidence.pairs()[1]
    assert chords.min() > -1e-9
    evidence.targets[7, 1:] *= -1.0
    np.testing.assert_allclose(np.delete(evidence.pairs()[1][7], 7), -np.delete(chords[7], 7))


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "draw"), [("dish", "even"), ("hook", "random")])
def test_nearly_any_flipped_normal_beside_thin_walls_is_found(shape: str, draw: str) -> None:
    sheet = contact_set(shape, ContactCase(draw, 40), seed=5).exact
    found = 0
    for row in range(len(sheet)):
        signs = np.where(np.arange(len(sheet)) == row, -1.0, 1.0)[:, None]
        wrong = replace(sheet, normals=signs * sheet.normals)
        found += judge_contacts(wrong).rows("flipped").tolist() == [row]
    assert found >= 0.9 * len(sheet)


def test_directions_of_approach_show_the_sides_of_a_tube(tmp_path: Path) -> None:
    tube = contact_set("hollow_cylinder", ContactCase("even", 40), seed=5).exact
    rng = np.random.default_rng(6)
    motions = unit(unit(rng.normal(size=(40, 3))) - tube.normals)  # the cosine law
    signs = np.where(rng.random(40) < 0.5, -1.0, 1.0)[:, None]
    rows = np.hstack([tube.points, signs * tube.normals, motions])
    for name, columns in (("bare.csv", 6), ("approached.csv", 9)):
        header = ",".join(["x", "y", "z", "nx", "ny", "nz", "ax", "ay", "az"][:columns])
        np.savetxt(tmp_path / name, rows[:, :columns], "%.12g", ",", header=header, comments="")
    with pytest.raises(EstimationError, match="approach"):
        load_contacts(tmp_path / "bare.csv", normals="unsigned")
    signed = load_contacts(tmp_path / "approached.csv", normals="unsigned")
    np.testing.assert_allclose(signed.normals, tube.normals, atol=1e-9)


def test_verdicts_follow_units_order_and_rigid_motions() -> None:
    wrong, which = flipped(touched(BOX, 60), 0.1)
    wrong = with_row(wrong, 13, [0.1, 0.02, 0.0], [0.6, 0.0, 0.8])
    codes = judge_contacts(wrong).codes
    assert np.count_nonzero(codes) == np.count_nonzero(which) + 1
    order = np.random.default_rng(3).permutation(len(wrong))
    np.testing.assert_array_equal(judge_contacts(wrong.subset(order)).codes, codes[order])
    turn = Rotation.from_euler("xyz", [0.3, 1.1, -2.0]).as_matrix()
    moved = Contacts(wrong.points @ turn.T + [0.2, -0.1, 0.4], wrong.normals @ turn.T)
    np.testing.assert_array_equal(judge_contacts(moved).codes, codes)
    larger = replace(wrong, points=25.4 * wrong.points)
    np.testing.assert_array_equal(judge_contacts(larger).codes, codes)


def test_free_space_shows_the_sides_of_two_sheets() -> None:
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.05, 0.05, (30, 2)), np.zeros(30)])
    points[15:, 2] = 0.004  # closer together than the contacts of each
    normals = np.tile([0.0, 0.0, -1.0], (30, 1))
    normals[15:] *= -1.0
    free = points + 0.006 * normals
    contacts = Contacts(points, normals, free_points=free, free_radii=np.full(30, 0.006))
    wrong = normals.copy()
    wrong[4] *= -1.0
    with_space = judge_contacts(replace(contacts, normals=wrong))
    without = judge_contacts(Contacts(points, wrong))
    assert with_space.rows("flipped").tolist() == [4]
    assert with_space.log_odds[4] > without.log_odds[4] + 5.0
    assert not judge_contacts(contacts).bad.any()


def test_one_viewpoint_cannot_see_all_sides_of_an_object() -> None:
    contacts = touched(BOX, 60)
    with pytest.raises(InvalidContactsError) as error:
        orient_normals(contacts, viewpoint=[0.0, 0.0, 1.0])
    assert error.value.field == "viewpoint"
    seen = contacts[np.flatnonzero(contacts.normals @ [0.48, 0.6, 0.64] > 0.1)]
    towards = np.array([0.48, 0.6, 0.64])
    inward = replace(seen, normals=-seen.normals)
    np.testing.assert_array_equal(orient_normals(inward, viewpoint=towards).normals, seen.normals)


@pytest.mark.parametrize("behind", [0.004, -0.002])
def test_a_large_fingertip_shows_its_side_beside_many_small_balls_behind(behind: float) -> None:
    """A tip of 12 mm touches each contact; balls of 2 mm are behind a thin wall, or overlap it."""
    contacts = touched(BOX, 24)
    tips = contacts.points + 0.012 * contacts.normals
    beside = 0.001 * np.random.default_rng(0).normal(size=(12, 24, 3))
    small = contacts.points - (behind + 0.002) * contacts.normals + beside
    free = np.vstack([tips, small.reshape(-1, 3)])
    radii = np.repeat([0.012, 0.002], [24, 12 * 24])
    contacts = replace(contacts, free_points=free, free_radii=radii)
    sides = Evidence.of(contacts, np.full(24, 0.0005), np.full(24, 0.05)).facing()
    assert (sides > 0.9).mean() > 0.9
