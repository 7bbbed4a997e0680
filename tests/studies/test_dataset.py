"""Data set of runs: its rows are what the files of the runs say."""

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import lis_grasp as lg
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.exploration import load_observations
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import Run
from lis_grasp_studies.cli import dataset
from lis_grasp_studies.dataset import _schema, run_folders, run_row, write_dataset
from lis_grasp_studies.lerobot_dataset import write_lerobot

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


ROOT = Path(__file__).parents[2]


def _section(name: str) -> str:
    """Return a section of the page of file formats."""
    page = (ROOT / "docs/reference/file-formats.md").read_text(encoding="utf-8")
    return page.split(f"\n## {name}\n")[1].split("\n## ")[0]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of objects by hands with different numbers of joints."""
    folder = tmp_path_factory.mktemp("runs")
    options = {"known": True, "prober": "kinematic", "touches": 8, "grasps": 3}
    lg.run("box", "wsg50", folder=folder / "box", **options)
    lg.run("mallet", "allegro", folder=folder / "mallet", seed=1, **options)
    return folder


def _fields(kind: Any) -> dict[str, Any]:
    """Return the fields of a struct, or of a list of structs, by their names."""
    from pyarrow import types

    inner = kind.value_type if types.is_list(kind) else kind
    return {inner.field(k).name: inner.field(k).type for k in range(inner.num_fields)}


@pytest.mark.slow
def test_every_row_has_the_columns_of_the_page_and_nothing_is_lost(runs: Path) -> None:
    import pyarrow

    lines = re.findall(r"^\| (`.*?) \| (.*) \|$", _section("runs.parquet"), re.MULTILINE)
    told = {name: kind for names, kind in lines for name in re.findall(r"`(\w+)`", names)}
    schema = _schema()
    assert list(told) == schema.names
    for name, kind in told.items():
        if "of `" in kind:
            within = re.findall(r"`(\w+)`", kind.split(";")[0])
            assert within == list(_fields(schema.field(name).type)), name
    for folder in run_folders(runs):
        row = run_row(folder)
        assert list(row) == schema.names
        one = pyarrow.Table.from_pylist([row], schema).to_pylist()[0]
        for name in ("probes", "grasps"):
            assert {*row[name][0]} == {*_fields(schema.field(name).type)}
            assert len(one[name]) == len(row[name])
        for name in ("contacts", "estimate", "truth"):
            assert {*row[name]} <= {*_fields(schema.field(name).type)}


@pytest.mark.slow
def test_the_reader_of_the_page_reads(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs)
    write_dataset(Path("runs.parquet"), run_folders(runs))
    [code] = re.findall(r"```py\n(.*?)```", _section("runs.parquet"), re.DOTALL)
    assert len(code.strip().splitlines()) <= 10
    found: dict[str, Any] = {}
    exec(code, found)
    run = Run.load(runs / "mallet")
    assert run.contacts is not None
    assert run.grasps is not None
    np.testing.assert_array_equal(found["points"], run.contacts.points)
    np.testing.assert_array_equal(found["X_OH"], [grasp.X_OH.ravel() for grasp in run.grasps])
    assert isinstance(found["held"], bool)


@pytest.mark.slow
def test_a_lerobot_episode_is_what_its_run_touched(runs: Path, tmp_path: Path) -> None:
    """The files were also read by the package lerobot 0.4.4, which needs torch."""
    from pyarrow.parquet import read_table

    folder = tmp_path / "touches"
    given = _parser().parse_args([str(runs), "--lerobot", str(folder)])
    assert given.execute(given) == 0
    info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    assert (info["codebase_version"], info["total_episodes"]) == ("v3.0", 2)
    episodes = read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    frames = read_table(folder / "data/chunk-000/file-000.parquet").to_pylist()
    assert info["total_frames"] == len(frames) == episodes[-1]["dataset_to_index"]
    assert [frame["index"] for frame in frames] == list(range(len(frames)))
    for episode in episodes:
        run = Run.load(Path(episode["run"]))
        assert run.contacts is not None
        assert run.lift is not None
        own = frames[episode["dataset_from_index"] : episode["dataset_to_index"]]
        probes = load_observations(run.folder / "touches.jsonl")
        assert len(own) == episode["length"] == len(probes)
        both = np.hstack([run.contacts.points, run.contacts.normals])
        for k, (frame, probe) in enumerate(zip(own, probes, strict=True)):
            count, wanted = frame["observation.count"], probe.outcome.probe
            assert count == sum(len(before.outcome.contacts) for before in probes[:k])
            padded = np.array(frame["observation.contacts"])
            np.testing.assert_allclose(padded[:count], both[:count], atol=1e-8)
            assert not padded[count:].any()
            np.testing.assert_allclose(
                frame["action"], [*wanted.target, *wanted.direction], atol=1e-7
            )
        assert [frame["next.done"] for frame in own] == [False] * (len(own) - 1) + [True]
        assert own[-1]["next.success"] == run.lift["held"]
        assert {frame["task_index"] for frame in own} == {episode["episode_index"]}


@pytest.mark.slow
def test_lerobot_statistics_are_those_of_all_frames(runs: Path, tmp_path: Path) -> None:
    from pyarrow.parquet import read_table

    write_lerobot(tmp_path / "set", run_folders(runs))
    frames = read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    statistics = json.loads((tmp_path / "set/meta/stats.json").read_text(encoding="utf-8"))
    assert {*statistics} == {*frames.column_names}
    for name, told in statistics.items():
        values = np.array(frames[name].to_pylist(), dtype=float)
        rows = values.reshape(-1, values.shape[-1] if values.ndim > 1 else 1)
        np.testing.assert_allclose(told["mean"], rows.mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(told["std"], rows.std(axis=0), atol=1e-7)
        np.testing.assert_array_equal(told["min"], rows.min(axis=0))
        np.testing.assert_array_equal(told["max"], rows.max(axis=0))


def test_a_lerobot_folder_with_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("kept", encoding="utf-8")
    with pytest.raises(InvalidFileError, match="empty folder"):
        write_lerobot(tmp_path, [])
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    dataset.add_arguments(parser)
    return parser
