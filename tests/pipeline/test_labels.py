"""Labelled grasps: the outcome of each lift, resumable, in the forms that others read."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from made_grasps import jaw_grasp

from lis_grasp import GraspSearch, Hand, pipeline, shapes
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exports.dexgraspbench import TabletopObject, save_for_dexgraspbench
from lis_grasp.grasping.export import save_isaac_grasps
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.io import provenance

parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra study")

JAW, BOX = Hand.load("wsg50"), shapes.build("box")
# In the middle, and beside the box, where nothing is lifted.
GRASPS = tuple(jaw_grasp(JAW, np.array([0.0, y, 0.02]), 0.084) for y in (0.0, 0.2))


def _write(folder: Path) -> Path:
    path = folder / "grasps.json"
    GraspSearch(GRASPS, {}, 2).save(path, header=provenance.describe(hand="wsg50", object="box"))
    return path


@pytest.mark.slow
def test_labels_are_those_of_the_lifts_and_a_second_call_lifts_what_is_missing(
    tmp_path: Path,
) -> None:
    path, lifted = _write(tmp_path), []

    def runner(
        label: Callable[[tuple[int, Grasp]], dict[str, Any]], jobs: Sequence[tuple[int, Grasp]]
    ) -> Iterator[dict[str, Any]]:
        for job in reversed(jobs):  # as a cluster, in any order
            if len(lifted) == stop:
                raise KeyboardInterrupt
            lifted.append(job[0])
            yield label(job)

    stop = 1
    with pytest.raises(KeyboardInterrupt):
        pipeline.label_file(path, runner=runner)
    stop = -1
    made = pipeline.label_file(path, runner=runner)
    assert lifted == [2, 1]
    assert [label["rank"] for label in made.labels] == [1, 2]
    assert [label["held"] for label in made.labels] == [True, False]
    assert dict(made.labels[0]) == dict(pipeline.lift_file(path, best=1).lifts[0])

    table = parquet.read_table(made.path)
    assert table.num_rows == 2
    assert table.column("held").to_pylist() == [True, False]
    for column in ("X_OH", "joint_positions", "contact_points", "contact_forces"):
        read = np.array(table.column(column).to_pylist())
        written = np.array([getattr(grasp, column).ravel() for grasp in GRASPS])
        np.testing.assert_array_equal(read, written)
    stop = 3
    with pytest.raises(KeyboardInterrupt):
        pipeline.label_file(path, runner=runner, friction=0.7)  # of another: from the beginning
    assert lifted == [2, 1, 2]
    assert provenance.parse(table.schema.metadata[b"lis_grasp"].decode())["hand"] == "wsg50"


def test_labels_are_in_the_files_of_isaac_and_dexgraspbench(tmp_path: Path) -> None:
    labels = [{"held": held, "slip": 0.01, "turn": np.pi / 2} for held in (True, False)]
    isaac = tmp_path / "grasps.isaac.yaml"
    save_isaac_grasps(isaac, GraspSearch(GRASPS), JAW, labels)
    entries = yaml.safe_load(isaac.read_text())["grasps"].values()
    assert [entry["confidence"] for entry in entries] == [1.0, 0.0]
    target = TabletopObject("box", [BOX.mesh], float(BOX.mesh.bounds[0, 2]))
    for given in (labels, ()):
        folder = save_for_dexgraspbench(tmp_path, target, JAW, GRASPS, given)
        of_stage = {
            stage: [
                np.load(file, allow_pickle=True).item()
                for file in sorted((folder / stage).glob("box/*.npy"))
            ]
            for stage in ("graspdata", "evaluation", "succgrasp")
        }
        assert [len(files) for files in of_stage.values()] == ([2, 2, 1] if given else [2, 0, 0])
        assert not any("succ_flag" in content for content in of_stage["graspdata"])
        for content, label in zip(of_stage["evaluation"], given, strict=True):
            assert content["succ_flag"] is label["held"]
            assert content["delta_angle"] == pytest.approx(90.0)
            assert content["delta_pos"] == 0.01


def test_a_file_without_an_object_is_refused_before_a_lift(tmp_path: Path) -> None:
    path = tmp_path / "grasps.json"
    GraspSearch(GRASPS).save(path)
    with pytest.raises(InvalidOptionError) as error:
        pipeline.label_file(path)
    assert error.value.option == "object"
    assert [file.name for file in tmp_path.iterdir()] == ["grasps.json"]
    assert json.loads(path.read_text())["grasps"]
