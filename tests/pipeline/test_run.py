"""A whole run in Python, and its results read back, all in one frame."""

from __future__ import annotations

from pathlib import Path

import pytest
from numpy.testing import assert_array_equal
from PIL import Image
from scenes import Told

from lis_grasp import pipeline, shapes
from lis_grasp.exceptions import EstimationError, InvalidFileError
from lis_grasp.exploration import ExplorationState
from lis_grasp.meshing import extract_mesh
from lis_grasp.pipeline import Run, RunConfig
from lis_grasp.pipeline.names_of_2 import UNKNOWN
from lis_grasp.shapes.mesh_distance import distances_to_mesh


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, list[str]]:
    config = RunConfig(
        **{**UNKNOWN, "region": tuple(UNKNOWN["region"]), "free": False},
        object="mallet",
        hand="wsg50",
        prober="kinematic",
        touches=11,
        grasps=2,
        attempts=1,
        seed=1,
    )
    progress = Told()
    folder = tmp_path_factory.mktemp("run")
    return pipeline.run(config, folder, progress=progress), progress.titles


@pytest.mark.slow
def test_a_run_reports_its_stages(results: tuple[Run, list[str]]) -> None:
    run, titles = results
    words = ["Touching", "Estimating", "Planning", "Lifting"]
    assert [title.split()[0] for title in titles][:4] == words
    # Eleven touches, and what the hand measured when it tested grasps.
    measured = sum(attempt["lesson"]["felt"] for attempt in run.report["attempts"][:-1])
    assert len(run.contacts) == 11 + measured
    assert titles[-1] == "Reporting"
    assert run.report["touches"] == 11
    assert (run.folder / "scene.html").exists()
    with Image.open(run.folder / "scene.png") as picture:
        assert picture.size == (640, 480)


@pytest.mark.slow
def test_contacts_estimate_and_true_object_are_in_one_frame(
    results: tuple[Run, list[str]],
) -> None:
    run, _ = results
    gaps = distances_to_mesh(run.contacts.points, run.truth.mesh)[0]
    assert gaps.max() < 0.004  # noise of 0.5 mm, and half a taxel of 2 mm
    own = distances_to_mesh(run.contacts.points, shapes.build("mallet").mesh)[0]
    assert own.mean() > 0.02  # the object's own frame is another
    assert_array_equal(extract_mesh(run.surface).vertices, run.mesh.vertices)


@pytest.mark.slow
def test_results_read_back_are_those_of_the_run(results: tuple[Run, list[str]]) -> None:
    run, _ = results
    again = Run.load(str(run.folder))
    assert again.task == run.task
    assert again.report == run.report
    assert again.lift == run.report["lift"]
    assert_array_equal(again.contacts.points, run.contacts.points)
    assert len(again.grasps.grasps) == len(run.grasps.grasps)
    assert (again.motion is None) == (not run.grasps.grasps)
    assert again.hand.name == "wsg50"
    assert len(repr(again).splitlines()[0]) == len(repr(again)) < 200


def test_a_folder_without_results_is_refused(tmp_path) -> None:
    with pytest.raises(InvalidFileError) as error:
        Run.load(tmp_path)
    assert error.value.path == tmp_path
    (tmp_path / "report.json").write_text("{}")
    for mistaken in (None, tmp_path / "report.json"):
        with pytest.raises(InvalidFileError) as error:
            Run.load(mistaken)
        assert error.value.path == Path(str(mistaken))


def test_a_run_without_a_contact_is_an_error(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = iter([ExplorationState(), ExplorationState(ended="nothing to touch")])
    monkeypatch.setattr("lis_grasp.results.exploring.touch_steps", lambda *_: steps)
    with pytest.raises(EstimationError, match="no contact"):
        pipeline.run(RunConfig(prober="kinematic", touches=2), tmp_path)
