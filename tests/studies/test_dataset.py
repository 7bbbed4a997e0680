"""Data set of runs: its rows are what the files of the runs say."""

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import lis_grasp as lg
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.exploration import load_observations
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.cli import dataset
from lis_grasp_studies.dataset import run_folders, write_dataset

pytest.importorskip("pyarrow")


def _rows(path: Path) -> list[Row]:
    from pyarrow.parquet import read_table

    rows: list[Row] = read_table(path).to_pylist()
    return rows


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"no run \(report.json\)"):
        run_folders(tmp_path)


def test_a_damaged_run_is_named_and_the_file_is_not_replaced(tmp_path: Path) -> None:
    folder, path = tmp_path / "damaged", tmp_path / "runs.parquet"
    folder.mkdir()
    for name in ("report.json", "grasps.json"):
        (folder / name).write_text("{", encoding="utf-8")
    path.write_bytes(b"before")
    with pytest.raises(InvalidFileError, match="damaged"):
        write_dataset(path, [folder])
    assert path.read_bytes() == b"before"


@pytest.mark.slow
def test_a_row_is_what_the_files_of_its_run_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"known": True, "prober": "kinematic", "touches": 8, "grasps": 3}
    run = lg.run("box", "wsg50", folder=tmp_path / "a" / "box", **options)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "report.json").write_text("{}", encoding="utf-8")
    path, parser = tmp_path / "runs.parquet", _parser()
    given = parser.parse_args([str(tmp_path), "--output", str(path)])
    assert given.execute(given) == 0
    assert "b is left out" in capsys.readouterr().err
    [row] = _rows(path)
    assert run.contacts is not None
    assert run.grasps is not None
    assert run.truth is not None
    assert run.mesh is not None
    assert run.lift is not None
    np.testing.assert_array_equal(row["contacts"]["points"], run.contacts.points)
    np.testing.assert_array_equal(row["contacts"]["normals"], run.contacts.normals)
    for name, mesh in (("estimate", run.mesh), ("truth", run.truth.mesh)):
        made = trimesh.Trimesh(row[name]["vertices"], row[name]["faces"], process=False)
        assert made.is_watertight
        assert made.volume == pytest.approx(mesh.volume, rel=1e-12)
    assert len(row["estimate"]["uncertainty"]) == len(run.mesh.vertices)
    assert [len(row["grasps"]), row["truth"]["uncertainty"]] == [len(run.grasps), None]
    for found, grasp in zip(row["grasps"], run.grasps, strict=True):
        np.testing.assert_array_equal(np.reshape(found["X_OH"], (4, 4)), grasp.X_OH)
        np.testing.assert_array_equal(found["contact_forces"], grasp.contact_forces)
        assert dict(found["quality"]) == dict(grasp.quality)
    probes = load_observations(run.folder / "touches.jsonl")
    assert [p["status"] for p in row["probes"]] == [p.outcome.status for p in probes]
    assert sum(p["contacts"] for p in row["probes"]) >= 8
    assert {n: row["lift"][n] for n in ("held", "reason", "slip")} == {
        n: run.lift[n] for n in ("held", "reason", "slip")
    }
    assert row["lift"]["grasp"] == run.report["attempts"][-1]["grasp"] - 1  # type: ignore[index]
    assert json.loads(row["task"])["touches"] == 8


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    dataset.add_arguments(parser)
    return parser
