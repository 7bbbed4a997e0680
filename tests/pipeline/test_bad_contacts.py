"""Bad contacts from file to page: named, repeated by later stages, and believed on request."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scenes import Told

from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, TooManyBadContactsError
from lis_grasp.pipeline import ContactSource, RunConfig, Scenario, estimate_file, grasp_file
from lis_grasp.results.page import scene_of
from lis_grasp.stages.estimate import estimate
from lis_grasp.stages.next_touch import ObjectPlace
from lis_grasp.stages.touch import make_perception
from lis_grasp.surfaces import judge_contacts
from lis_grasp.task.recorded_facts import read_facts

BOX = trimesh.creation.box(extents=[0.06, 0.05, 0.04])
FLIPPED, STRAY = 7, 20


@pytest.fixture
def touches(tmp_path: Path) -> Path:
    """Contacts of a box of which one is flipped and one a touch of something else."""
    points, faces = trimesh.sample.sample_surface_even(BOX, 60, seed=1)
    normals = BOX.face_normals[faces].copy()
    normals[FLIPPED] *= -1.0
    points[STRAY] += [0.0, 0.12, 0.03]
    path = tmp_path / "touches.csv"
    Contacts(points, normals).save(path)
    return path


@pytest.mark.slow
def test_an_estimate_names_bad_contacts_and_grasps_repeat_it(touches: Path) -> None:
    said = Told()
    made = estimate_file([ContactSource(touches)], touches.parent / "out", progress=said)
    np.testing.assert_allclose(1e3 * made.mesh.extents, [60.0, 50.0, 40.0], atol=0.2)
    assert len(Contacts.load(made.path.with_name("contacts.ply"))) == 60  # what was measured
    facts = read_facts(made.path)
    assert (facts["turned"], facts["left_out"]) == ([FLIPPED], [STRAY])
    assert np.shape(facts["doubt_log_odds"]) == (2,)
    assert min(facts["doubt_log_odds"]) > 0.0
    table, warning = facts["warnings"]
    assert all(f"row {row + 1}" in warning for row in (FLIPPED, STRAY))
    assert any(warning in line for line in said.lines)
    assert sorted(scene_of(made.path.parent).bad_contacts) == [FLIPPED, STRAY]
    again = Told()
    grasped = grasp_file(made.path, hand="wsg50", grasps=1, progress=again)
    for line in (warning, table):
        assert any(line in said for said in again.lines)
    lowest = made.contacts.bounds[0, 2]  # the table that `next` takes, too
    assert grasped.agent.support_height == ObjectPlace().table(made.contacts) == lowest
    given = Told()
    grasp_file(made.path, hand="wsg50", grasps=1, support=lowest - 0.001, progress=given)
    assert not any(table in said for said in given.lines)


def test_contacts_are_judged_once_for_strays_and_estimate(
    touches: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = Scenario.from_config(RunConfig("box", hand="wsg50")).agent
    judged: list[Contacts] = []
    monkeypatch.setattr(
        "lis_grasp.stages.estimate.judge_contacts",
        lambda contacts, **noise: judged.append(contacts) or judge_contacts(contacts, **noise),
    )
    perception, contacts = make_perception(known.perception), Contacts.load(touches)
    assert perception.find_strays is not None
    assert STRAY in perception.find_strays(contacts)
    perception.estimate(contacts)
    assert len(judged) == 1
    assert Contacts.empty().append(contacts) is contacts


def test_all_contacts_are_believed_on_request(touches: Path) -> None:
    made = estimate_file([ContactSource(touches)], touches.parent / "out", keep_all=True)
    assert np.abs(1e3 * made.mesh.extents - [60.0, 50.0, 40.0]).max() > 1.0
    assert "left_out" not in read_facts(made.path)


@pytest.mark.slow
@pytest.mark.parametrize("copies", [pytest.param(1, marks=pytest.mark.slow), 4])
def test_few_places_are_warned_of_by_grasps_too(tmp_path: Path, copies: int) -> None:
    axes = np.vstack([np.eye(3), -np.eye(3)] * copies)
    Contacts(0.03 * axes, axes).save(tmp_path / "six.csv")
    made = estimate_file([ContactSource(tmp_path / "six.csv")], tmp_path / "out")
    said = Told()
    grasp_file(made.path, hand="wsg50", grasps=1, progress=said)
    assert any("fewer than 10 contacts" in line for line in said.lines)


@pytest.mark.by_default("0.0-reaches 20 mm below the table, z = 0 m")
@pytest.mark.parametrize(
    ("support", "warning"),
    [
        (None, "no table is known"),
        (0.0, "reaches 20 mm below the table, z = 0 m"),
        (-0.02, ""),
        pytest.param(-0.03, "", marks=pytest.mark.slow),
    ],
)
def test_a_table_that_is_unknown_or_inside_the_mesh_is_warned_of(
    tmp_path: Path, support: float | None, warning: str
) -> None:
    BOX.export(tmp_path / "box.stl")
    said = Told()
    grasp_file(tmp_path / "box.stl", hand="wsg50", grasps=1, support=support, progress=said)
    warnings = [line for line in said.lines if line.startswith("warning")]
    assert len(warnings) == bool(warning)
    assert all(warning in line for line in warnings)


@pytest.mark.slow
def test_half_flipped_normals_are_refused_oriented_or_believed_on_request(
    touches: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    contacts = Contacts.load(touches)
    contacts = contacts.subset(np.arange(60) != STRAY)
    signs = np.where(np.random.default_rng(0).random(59) < 0.5, -1.0, 1.0)[:, None]
    replace(contacts, normals=signs * contacts.normals).save(touches)
    with pytest.raises(TooManyBadContactsError) as error:
        estimate_file([ContactSource(touches, normals="outward")], touches.parent / "out")
    assert error.value.count == 59
    source = ContactSource(touches, normals="unsigned")
    made = estimate_file([source], touches.parent / "out")
    np.testing.assert_allclose(1e3 * made.mesh.extents, [60.0, 50.0, 40.0], atol=0.2)
    replace(contacts, normals=signs * contacts.normals).save(touches)
    command = ["next", str(touches), "--hand", "wsg50", "--estimator", "gpis"]
    assert main(command) == 1
    refused = capsys.readouterr()
    assert (refused.out, "--keep-all" in refused.err) == ("", True)
    assert main([*command, "--keep-all"]) == 0
    with pytest.raises(TooManyBadContactsError) as error:
        estimate(Contacts.load(touches), "gpis")
    assert error.value.count == 59
    assert estimate(Contacts.load(touches), "gpis", keep_all=True).bounds.shape == (2, 3)
    away = ContactSource(touches, viewpoint=[0.0, 0.0, 1.0])
    with pytest.raises(InvalidContactsError) as error:
        estimate_file([away], touches.parent / "view")  # a closed object is not seen from there
    assert error.value.field == "viewpoint"


@pytest.mark.parametrize(("apart", "doubted"), [(0.12, True), (0.0, False)])
def test_contacts_of_two_objects_are_told(tmp_path: Path, apart: float, doubted: bool) -> None:
    points, faces = trimesh.sample.sample_surface_even(BOX, 60, seed=1)
    shift = np.where(np.arange(60) % 2, apart, 0.0)[:, None] * [1.0, 0.0, 0.0]
    Contacts(points + shift, BOX.face_normals[faces]).save(path := tmp_path / "two.csv")
    said = Told()
    estimate_file([ContactSource(path)], tmp_path / "out", progress=said, estimator="gpis")
    told = "the estimate has 2 separate bodies that were touched"
    assert any(told in line for line in said.lines) == doubted
