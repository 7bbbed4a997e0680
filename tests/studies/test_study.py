"""Studies: definition, keys and rows, resumption, and equality of rows from every scheduler."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_grasps import jaw_grasp

from lis_grasp import pipeline, shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    EstimationError,
    InvalidFileError,
    InvalidHandError,
    InvalidOptionError,
)
from lis_grasp.exploration import Exploration
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io.json_lines import Row
from lis_grasp.robots.hand import Hand
from lis_grasp_studies.harness.parquet import read_parquet
from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.harness.runner import DaskCluster, InProcess, LocalPool, run_trials
from lis_grasp_studies.study import run as trial_module
from lis_grasp_studies.study.columns import (
    COLUMNS,
    blank_row,
    quality_columns,
    search_columns,
)
from lis_grasp_studies.study.results import (
    StudyResults,
    column_type,
    job_of,
    without_times,
)
from lis_grasp_studies.study.run import (
    GraspTask,
    grasp_and_lift,
    run_trial,
    touch,
)
from lis_grasp_studies.study.study import Study, load_study
from lis_grasp_studies.study.trial import OBJECT_NAMES, Setup, Trial, parse_noise, row_key

pytest.importorskip("pyarrow", reason="needs lis-grasp[study]")

SMALL = Study(
    objects=("box", "sphere"),
    estimators=("gpis", "blend"),
    touches=(6, 12),
    noise=("none",),
    seeds=(0, 1),
)


def fake_rows(job: Job) -> list[Row]:
    """Return rows that are as a trial's, at once."""
    return [
        blank_row(job.trial, name, shapes.build(job.trial.object))
        | {"rmsd": 0.1 + 0.2 * job.trial.seed, "contacts": job.trial.touches, "seconds_touch": 1.0}
        for name in job.variants
    ]


def run(study: Study, folder: Path, scheduler: object = None, runner: object = fake_rows) -> int:
    results = StudyResults(folder)
    return len(list(steps_of(study, results, scheduler or InProcess(), runner))) - 1


def steps_of(
    study: Study, results: StudyResults, scheduler: Any, runner: Any
) -> Iterator[tuple[int, int]]:
    jobs, total = results.missing(study), len(study.trials())
    return run_trials(jobs, total, results.lines, scheduler, runner)


def keys_in(folder: Path) -> set[str]:
    return {row["key"] for row in StudyResults(folder).read()}


def comparable(study: Study, folder: Path) -> list[Row]:
    """Return the rows without times, with every column."""
    rows = StudyResults(folder).of(study)
    return [without_times({name: row.get(name) for name in COLUMNS}) for row in rows]


def test_objects_draw_different_random_numbers_with_one_seed() -> None:
    names = ("box", "sphere", "scans/mug.stl")
    seeds = {Trial(name, "allegro", 10, "none", s).random_seed for name in names for s in range(3)}
    assert len(seeds) == 9
    first, second = (
        Trial(f"{f}/mug.stl", "allegro", t, "none", 0) for f, t in (("a", 5), ("b", 40))
    )
    assert first.random_seed == second.random_seed  # the folder and the budget do not matter


def test_trials_are_a_full_factorial_ordered_by_seed() -> None:
    trials = SMALL.trials()
    assert len(trials) == len(set(trials)) == 2 * 2 * 1 * 1 * 2
    assert [trial.seed for trial in trials] == sorted(trial.seed for trial in trials)


def test_a_study_comes_back_from_its_facts() -> None:
    study = dataclasses.replace(SMALL, explorer="own", policy="frontier", grasps=3)
    assert Study.from_facts(study.facts()) == study
    assert Study.from_facts({"seeds": 3}).seeds == (0, 1, 2)


def test_a_study_is_read_from_yaml(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("objects: [box]\nnoise: [none, 1mm/3deg]\nseeds: 2\nmass: 0.3\n")
    study = Study.from_facts(load_study(path))
    assert study.objects == ("box",)
    assert study.noise == ("none", "1mm/3deg")
    assert study.setup.mass == study.mass == 0.3


@pytest.mark.parametrize(
    ("facts", "option"),
    [
        ({"object": ["box"]}, "each key of a study"),
        ({"objects": "box"}, "objects"),
        ({"objects": []}, "objects"),
        ({"estimators": ["gpis", "blnd"]}, "estimators"),
        ({"estimators": ["blend"]}, "reference"),
        ({"estimators": ["gpis", "gpis_rfb"]}, "estimators"),
        ({"touches": [0]}, "touches"),
        ({"touches": [10, 10]}, "touches"),
        ({"touches": [1.5]}, "touches"),
        ({"seeds": 0}, "seeds"),
        ({"seeds": [-1]}, "seeds"),
        ({"seeds": [2**63]}, "seeds"),
        ({"noise": ["1mm"]}, "noise"),
        ({"noise": [{"position": 0.001}]}, "noise"),
        ({"hands": [3]}, "hands"),
        ({"explorer": "own"}, "policy"),
        ({"explorer": "gps"}, "explorer"),
        ({"mass": "heavy"}, "mass"),
        ({"mass": True}, "mass"),
        ({"mass": 10**400}, "mass"),
        ({"grasps": 1.5}, "grasps"),
        ({"grasps": True}, "grasps"),
        ({"units": "furlong"}, "units"),
        *(
            ({"prober": "none"}, "prober"),
            ({"policy": "psychic"}, "policy"),
            ({"mass": -1.0}, "mass"),
        ),
    ],
)
def test_an_error_in_a_study_names_the_option(facts: dict, option: str) -> None:
    with pytest.raises(InvalidOptionError) as error:
        Study.from_facts(facts)
    assert error.value.option == option


def test_unknown_names_of_objects_and_hands_are_errors() -> None:
    with pytest.raises(InvalidOptionError) as error:
        Study.from_facts({"objects": ["bx"]})
    assert (error.value.option, error.value.value) == ("object", "bx")
    with pytest.raises(InvalidHandError):
        Study.from_facts({"hands": ["claw"]})


def test_the_schema_describes_every_key_of_a_study_file() -> None:
    schema = Study.schema()
    assert set(schema["properties"]) == set(SMALL.facts())
    assert schema["additionalProperties"] is False
    assert "kinematic" in schema["properties"]["prober"]["enum"]
    assert {"type": "integer"} in schema["properties"]["seeds"]["anyOf"]


@pytest.mark.parametrize("text", ["objects: [box", "- box", None])
def test_a_file_that_is_no_study_is_an_error(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "study.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InvalidFileError) as error:
        load_study(path)
    assert error.value.path == path


def test_noise_is_in_metres_and_radians() -> None:
    assert not parse_noise("none").any
    assert parse_noise("1mm/3deg").position == pytest.approx(1e-3)
    assert parse_noise("0.5mm/3deg").normal == pytest.approx(np.pi / 60)


def test_a_key_depends_on_everything_that_decides_a_row() -> None:
    trial = Trial("box", "allegro", 10, "none", 0)
    others = [
        row_key(dataclasses.replace(trial, **{name: value}), "gpis")
        for name, value in (
            ("object", "torus"),
            ("hand", "wsg50"),
            ("touches", 11),
            ("noise", "1mm/3deg"),
            ("seed", 1),
            ("setup", Setup(mass=0.3)),
        )
    ]
    others.append(row_key(trial, "lis"))
    assert len({row_key(trial, "gpis"), *others}) == len(others) + 1
    assert row_key(trial, "gpis") == row_key(dataclasses.replace(trial, setup=Setup()), "gpis")


def test_keys_of_the_published_rows_are_unchanged() -> None:
    rows = read_parquet(Path(__file__).parents[2] / "docs" / "study" / "rows-0.11.parquet")
    assert len(rows) == 3720
    known_by_name = [r for r in rows if r["object"] in OBJECT_NAMES and r["hand"] != "leap"]
    assert len(known_by_name) > 1000
    for row in known_by_name[::50]:
        assert job_of(row).variants == (row["estimator"],)  # an error if its key is another


def test_whole_numbers_are_numbers_in_a_key() -> None:
    facts = {"mass": 1, "friction": 1, "size": 1, "grasps": 2}
    whole, real = (Study.from_facts(SMALL.facts() | facts | more) for more in ({}, {"mass": 1.0}))
    assert row_key(whole.trials()[0], "gpis") == row_key(real.trials()[0], "gpis")
    (row,) = fake_rows(Job(whole.trials()[0], ("gpis",)))
    # As Parquet gives them back.
    assert job_of(row | {"mass": 1.0, "friction": 1.0, "size": 1.0}).trial.setup == whole.setup


def test_a_file_counts_by_its_content(tmp_path: Path) -> None:
    path = tmp_path / "block.stl"
    trial = Trial(str(path), "allegro", 10, "none", 0)
    keys = set()
    for made, size in ((1000, 0.10), (1001, 0.12), (1002, 0.10)):
        shapes.build("box", size).mesh.export(path)
        os.utime(path, (made, made))  # two files of one tick of the clock have the same
        keys.add(row_key(trial, "gpis"))
    assert len(keys) == 2


def exported_block(folder: Path, *, size: float = 0.10) -> Path:
    folder.mkdir(exist_ok=True)
    shapes.build("box", size).mesh.export(folder / "block.stl")
    return folder / "block.stl"


def test_keys_do_not_depend_on_the_folder_of_a_file(tmp_path: Path) -> None:
    here, there = (exported_block(tmp_path / name) for name in ("here", "there"))
    study = dataclasses.replace(SMALL, objects=("box", str(here)))
    moved = dataclasses.replace(SMALL, objects=("box", str(there)))
    run(study, tmp_path / "results", runner=named_rows)
    assert StudyResults(tmp_path / "results").missing(moved) == []
    rows = StudyResults(tmp_path / "results").of(moved)
    assert {row["object"] for row in rows} == {"box", "block.stl"}
    for row in rows:
        assert (row["object_digest"] is None) == (row["object"] == "box")
        assert not any(str(tmp_path) in str(value) for value in row.values())
    again = exported_block(tmp_path / "there", size=0.12)
    assert len(StudyResults(tmp_path / "results").missing(moved)) == 4, again


def named_rows(job: Job) -> list[Row]:
    """Return rows as a trial's, at once, of objects in files too."""
    shape = shapes.build("box")
    return [blank_row(job.trial, name, shape) for name in job.variants]


def test_test_objects_are_known_by_name_in_a_size_that_a_hand_can_grasp() -> None:
    study = dataclasses.replace(SMALL, objects=("box", "roof", "ruler"), size=None)
    _, roof, ruler = (Trial(name, "allegro", 3, "none", 0).find_object() for name in study.objects)
    assert roof.size == pytest.approx(0.1)
    assert ruler.size == pytest.approx(0.2)  # a tool has its own size
    assert roof.mesh.is_watertight
    assert len(roof.edges)
    trial = next(trial for trial in study.trials() if trial.object == "roof")
    (row,) = named_rows(Job(trial, ("gpis",)))
    assert row["object_digest"] is None
    assert job_of(row).trial == trial
    with pytest.raises(InvalidOptionError) as error:
        dataclasses.replace(SMALL, objects=("no_such_thing",))
    assert (error.value.option, error.value.value) == ("object", "no_such_thing")


def test_a_row_is_repeated_only_with_the_same_file(tmp_path: Path) -> None:
    block = exported_block(tmp_path / "here")
    trial = Trial(str(block), "allegro", 6, "none", 0)
    (row,) = named_rows(Job(trial, ("gpis",)))
    assert job_of(row, [str(block)]) == Job(trial, ("gpis",))
    with pytest.raises(InvalidOptionError) as missing:
        job_of(row)
    assert missing.value.value == "block.stl"
    exported_block(tmp_path / "here", size=0.12)
    with pytest.raises(InvalidOptionError) as changed:
        job_of(row, [str(block)])
    assert changed.value.value == row["key"]


def test_a_running_process_notices_a_changed_file(tmp_path: Path) -> None:
    def largest_coordinate(size: float) -> float:
        block = exported_block(tmp_path, size=size)
        trial = Trial(str(block), "allegro", 3, "none", 0)
        contacts = touch(trial, "blend").contacts
        return float(np.abs(contacts.points).max())

    assert largest_coordinate(0.14) > 1.2 * largest_coordinate(0.10)
    # A hand's files count as well: tasks on one mesh differ where they do.
    box, hand = shapes.build("box"), Hand.load("allegro")
    trial = Trial("box", "own.yaml", 0, "", 0)
    a, b = (
        GraspTask("mesh", None, (digest,), trial, box.mesh, None, box, hand)
        for digest in ("a", "b")
    )
    assert a != b


def test_relative_paths_start_at_the_study_s_folder_or_the_meshes(tmp_path: Path) -> None:
    block = exported_block(tmp_path / "shapes")
    path = tmp_path / "study.yaml"
    path.write_text("objects: [box, shapes/block.stl]\n")
    assert load_study(path)["objects"] == ["box", str(block)]
    path.write_text("objects: [box, block.stl]\n")
    assert load_study(path, block.parent)["objects"] == ["box", str(block)]
    Study.from_facts(load_study(path, block.parent))
    with pytest.raises(InvalidFileError):
        Study.from_facts(load_study(path)).require_files()


def test_files_of_one_name_are_an_error(tmp_path: Path) -> None:
    both = tuple(str(exported_block(tmp_path / name)) for name in ("here", "there"))
    with pytest.raises(InvalidOptionError) as error:
        dataclasses.replace(SMALL, objects=both)
    assert (error.value.option, error.value.value) == ("objects", "block.stl")


def test_a_study_continues_from_the_merged_file_alone(tmp_path: Path) -> None:
    half = dataclasses.replace(SMALL, seeds=(0,))
    run(half, tmp_path / "first")
    merged = StudyResults(tmp_path / "first").write_merged()
    (tmp_path / "second").mkdir()
    merged.rename(tmp_path / "second" / "rows.parquet")
    results = StudyResults(tmp_path / "second")
    assert {job.trial.seed for job in results.missing(SMALL)} == {1}
    run(SMALL, tmp_path / "second")
    run(SMALL, tmp_path / "whole")
    assert comparable(SMALL, tmp_path / "second") == comparable(SMALL, tmp_path / "whole")
    # Merging again loses nothing, whoever wrote it.
    results.write_merged()
    assert keys_in(tmp_path / "second") == keys_in(tmp_path / "whole")


def test_every_compared_estimator_can_be_studied() -> None:
    names = ("gpis", "gpis_rbf", "gpis_thin_plate", "hermite_rbf", "patch", "truth")
    assert dataclasses.replace(SMALL, estimators=names).estimators == names
    with pytest.raises(InvalidOptionError) as error:  # a baseline cannot drive an exploration
        dataclasses.replace(
            SMALL, estimators=("gpis", "hermite_rbf"), explorer="own", policy="frontier"
        )
    assert error.value.value == "hermite_rbf"


def test_rows_are_read_without_any_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    block = exported_block(tmp_path / "here")
    study = dataclasses.replace(SMALL, objects=("box", str(block)))
    run(study, tmp_path, runner=named_rows)
    rows = StudyResults(tmp_path).of(study)
    block.unlink()
    elsewhere = dataclasses.replace(study, objects=("box", "/nowhere/block.stl"))
    with monkeypatch.context() as later:
        later.setattr("lis_grasp.__version__", "9.9.9")
        assert StudyResults(tmp_path).alike(elsewhere) == rows
        assert StudyResults(tmp_path).alike(dataclasses.replace(study, mass=0.3)) == []
    with pytest.raises(InvalidFileError) as error:
        StudyResults(tmp_path).missing(elsewhere)
    assert error.value.path == Path("/nowhere/block.stl")


def test_rows_of_two_files_of_one_name_are_an_error(tmp_path: Path) -> None:
    for size in (0.10, 0.12):
        block = exported_block(tmp_path / "here", size=size)
        study = dataclasses.replace(SMALL, objects=(str(block),))
        run(study, tmp_path, runner=named_rows)
    with pytest.raises(InvalidFileError) as error:
        StudyResults(tmp_path).alike(study)
    assert error.value.path == tmp_path


def test_a_row_with_a_mapping_in_place_of_a_name_is_refused(tmp_path: Path) -> None:
    run(SMALL, tmp_path, runner=named_rows)
    header, first, *rest = (tmp_path / "rows.jsonl").read_text().splitlines()
    damaged = json.dumps(json.loads(first) | {"object": {}})
    (tmp_path / "rows.jsonl").write_text("\n".join([header, damaged, *rest, ""]))
    with pytest.raises(InvalidFileError) as error:
        StudyResults(tmp_path).alike(SMALL)
    assert error.value.path == tmp_path


def test_rows_come_back_as_they_were_written(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    written = [
        row for job in StudyResults(tmp_path / "no").missing(SMALL) for row in fake_rows(job)
    ]
    assert StudyResults(tmp_path).of(SMALL) == written
    StudyResults(tmp_path).write_merged()
    (tmp_path / "rows.jsonl").unlink()
    assert StudyResults(tmp_path).of(SMALL) == written


def test_columns_of_a_grasp_have_the_types_that_are_read() -> None:
    hand, box, trial = (
        Hand.load("wsg50"),
        shapes.build("box", None),
        Trial("box", "wsg50", 4, "none", 0),
    )
    qualities = ("epsilon", "closure_probability", "success_probability")
    made = jaw_grasp(hand, np.zeros(3), 0.05)
    grasp = dataclasses.replace(made, quality=dict.fromkeys(qualities, 0.5))
    columns = quality_columns(grasp, box.mesh, trial, hand)
    columns |= search_columns(GraspSearch((grasp,), {"steep": 3}, 7))
    assert {type(value) for value in columns.values()} == {int, float, str}
    assert all(type(value) is column_type(name) for name, value in columns.items())
    assert set(columns) <= set(COLUMNS)


def test_a_row_has_all_columns_and_no_other() -> None:
    (row,) = run_trial(Job(Trial("box", "allegro", 8, "none", 0), ("blend",)))
    assert set(row) == set(COLUMNS)
    assert row["failure"] is None
    assert row["grasps_found"] is not None


def test_an_interrupted_study_continues_without_repeating_rows(tmp_path: Path) -> None:
    asked: list[Job] = []

    def counting(job: Job) -> list[Row]:
        asked.append(job)
        if len(asked) == 4:
            raise KeyboardInterrupt
        return fake_rows(job)

    with pytest.raises(KeyboardInterrupt):
        run(SMALL, tmp_path, runner=counting)
    assert len(keys_in(tmp_path)) == 3 * 2
    with (tmp_path / "rows.jsonl").open("a") as file:
        file.write('{"key": "to')  # killed while writing
    run(SMALL, tmp_path, runner=counting)
    # Nothing is done twice but the trial that was cut off.
    assert len(asked) == len(SMALL.trials()) + 1
    assert run(SMALL, tmp_path) == 0
    run(SMALL, tmp_path / "whole")
    assert comparable(SMALL, tmp_path) == comparable(SMALL, tmp_path / "whole")


def test_only_an_added_estimator_is_run(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    more = dataclasses.replace(SMALL, estimators=("gpis", "blend", "lis"))
    assert {job.variants for job in StudyResults(tmp_path).missing(more)} == {("lis",)}


def test_rows_of_another_version_are_errors_before_the_work_and_as_they_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def outdated(job: Job) -> list[Row]:
        return [row | {"version": "0.0.9"} for row in fake_rows(job)]

    with pytest.raises(InvalidFileError) as error:
        run(SMALL, tmp_path, runner=outdated)
    assert error.value.path == tmp_path / "rows.jsonl"
    assert not keys_in(tmp_path)
    run(dataclasses.replace(SMALL, seeds=(0,)), tmp_path)
    run(dataclasses.replace(SMALL, seeds=(0,)), tmp_path / "merged")
    StudyResults(tmp_path / "merged").write_merged()
    (tmp_path / "merged" / "rows.jsonl").unlink()
    monkeypatch.setattr("lis_grasp.version.__version__", "9.9.9")
    for folder, file in ((tmp_path, "rows.jsonl"), (tmp_path / "merged", "rows.parquet")):
        with pytest.raises(InvalidFileError) as error:
            run(SMALL, folder, runner=lambda _: pytest.fail("nothing is to be run"))
        assert error.value.path == folder / file


@pytest.mark.parametrize("text", ["unexpected", "unexpected " * 200])
def test_an_unexpected_error_is_named_and_stops_no_other_trial(tmp_path: Path, text: str) -> None:
    def mistaken(job: Job) -> list[Row]:
        if (job.trial.object, job.trial.touches) == ("box", 6):
            raise ZeroDivisionError(text)
        return fake_rows(job)

    with pytest.raises(EstimationError, match="2 trials") as caught:
        run(SMALL, tmp_path, runner=mistaken)
    assert "ZeroDivisionError" in str(caught.value)
    assert "unexpected" in str(caught.value)
    assert len(StudyResults(tmp_path).missing(SMALL)) == 2


@pytest.mark.parametrize("times", [1, 2])
def test_a_trial_whose_file_is_missing_is_tried_again(tmp_path: Path, times: int) -> None:
    tries = 0

    def unreadable(job: Job) -> list[Row]:
        nonlocal tries
        if (job.trial.object, job.trial.touches, job.trial.seed) == ("box", 6, 0):
            tries += 1
            if tries <= times:
                raise InvalidFileError("box.stl is gone")
        return fake_rows(job)

    if times == 1:
        run(SMALL, tmp_path, runner=unreadable)
    else:
        with pytest.raises(EstimationError, match="1 trials .*box.stl is gone"):
            run(SMALL, tmp_path, runner=unreadable)
        assert len(StudyResults(tmp_path).missing(SMALL)) == 1
        run(SMALL, tmp_path, runner=unreadable)
    assert StudyResults(tmp_path).missing(SMALL) == []


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    merged = StudyResults(tmp_path).write_merged()
    merged.write_bytes(merged.read_bytes()[:50])
    with pytest.raises(InvalidFileError) as error:
        StudyResults(tmp_path).read()
    assert error.value.path == merged
    merged.unlink()
    lines = tmp_path / "rows.jsonl"
    sound = lines.read_bytes()
    for part, damaged, field in (
        (b'"key"', b'"kez"', "key"),
        (b'"touches": ', b'"touches": 0.5', "touches"),
        (b'"mass": 0.2', b'"mass": "0.2"', "mass"),
    ):
        assert part in sound
        lines.write_bytes(sound.replace(part, damaged))
        with pytest.raises(InvalidFileError) as error:
            StudyResults(tmp_path).read()
        assert (error.value.path, error.value.field) == (tmp_path, field)


def test_a_row_is_found_by_the_beginning_of_its_key(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    results = StudyResults(tmp_path)
    row = results.of(SMALL)[3]
    assert results.row(row["key"][:8]) == row
    assert row_key(job_of(row).trial, row["estimator"]) == row["key"]
    for key in ("", "nothing"):  # of 16 rows, and of none
        with pytest.raises(InvalidOptionError) as error:
            results.row(key)
        assert (error.value.option, error.value.value) == ("rerun", key)


def forget() -> None:
    trial_module._explored.cache_clear()


def test_a_smaller_budget_s_contacts_are_the_first_of_a_larger_one() -> None:
    larger = Trial("mallet", "allegro", 14, "1mm/3deg", 3)
    forget()
    many = touch(larger, "blend").contacts
    few = touch(dataclasses.replace(larger, touches=9), "blend").contacts
    assert (len(few), len(many)) == (9, 14)
    np.testing.assert_array_equal(few.points, many.points[:9])
    np.testing.assert_array_equal(few.normals, many.normals[:9])
    free = len(few.free_points)
    np.testing.assert_array_equal(few.free_points, many.free_points[:free])


def test_a_larger_budget_continues_a_smaller_one(monkeypatch: pytest.MonkeyPatch) -> None:
    smaller = Trial("hollow_cylinder", "wsg50", 5, "1mm/3deg", 2)
    larger = dataclasses.replace(smaller, touches=11)
    forget()
    whole = touch(larger, "blend").contacts
    forget()
    before = touch(smaller, "blend").seconds
    given = []
    explore = pipeline.touch

    def spy(*arguments: Any, **options: Any) -> Exploration:
        given.append(len(options["recorded"]))
        return explore(*arguments, **options)

    monkeypatch.setattr(pipeline, "touch", spy)
    continued = touch(larger, "blend")
    grown = continued.contacts
    assert given[0] >= 5
    assert continued.seconds > before
    np.testing.assert_array_equal(grown.points, whole.points)
    np.testing.assert_array_equal(grown.normals, whole.normals)
    np.testing.assert_array_equal(grown.free_points, whole.free_points)


@pytest.mark.slow
def test_a_trial_of_an_unknown_free_object_is_judged_where_the_object_is() -> None:
    setup = Setup(conditions="unknown", prober="dynamic", size=0.08)
    trial = Trial("box", "allegro", 20, "0.5mm/3deg", 1, setup)
    forget()
    touched = touch(trial, "blend")
    assert touched.X_EO is not None  # pushed a little, and tracked
    rows = run_trial(Job(trial, ("blend", "truth")))
    assert [row["contacts"] for row in rows] == [20, 20]
    assert rows[0]["rmsd"] < 0.005  # the region is 400 mm wide
    assert rows[1]["rmsd"] < 1e-9
    assert rows[1]["held"]
    assert {row["conditions"] for row in rows} == {"unknown"}
    with pytest.raises(InvalidOptionError) as error:
        Setup(conditions="unknown")
    assert error.value.option == "free"


def test_equal_grasp_tasks_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    planned = []

    def plan(*arguments: Any) -> GraspSearch:
        planned.append(arguments)
        return GraspSearch((), {"ik": len(planned)}, candidates=len(planned))

    monkeypatch.setattr("lis_grasp_studies.study.run.plan_grasps", plan)
    grasp_and_lift.cache_clear()
    first, second = (Trial("sphere", "wsg50", touches, "none", 5) for touches in (5, 6))
    rows = [run_trial(Job(trial, ("truth", "patch"))) for trial in (first, second)]
    assert len(planned) == 3  # the truth once, the patches of 5 and of 6 contacts
    assert rows[0][0]["candidates"] == rows[1][0]["candidates"] == 1
    assert [row[1]["candidates"] for row in rows] == [2, 3]
    assert rows[0][0]["contacts"] != rows[1][0]["contacts"]


def test_failures_are_rows_with_their_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def estimate(*_: object) -> None:
        raise EstimationError("no surface of this kind")

    monkeypatch.setattr(trial_module, "find_estimator", lambda *_, **__: estimate)
    (row,) = run_trial(Job(Trial("box", "allegro", 4, "none", 0), ("gpis",)))
    assert (row["reason"], row["held"]) == ("failed", False)
    assert row["failure"] == "EstimationError: no surface of this kind"
    assert row["contacts"] == 4


def test_an_object_that_was_never_touched_is_a_failure_of_its_trial(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forget()
    monkeypatch.setattr(pipeline, "touch", lambda *_, **__: Exploration(Contacts.empty(), ()))
    (row,) = run_trial(Job(Trial("box", "allegro", 4, "none", 99), ("gpis",)))
    forget()
    assert row["failure"].startswith("EstimationError")
    assert row["contacts"] == 0


def slow_rows(job: Job) -> list[Row]:
    """Kill the process that runs it, the first time; a file remembers."""
    mark = Path(os.environ["STUDY_MARK"])
    if job.trial.seed == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return fake_rows(job)


def deadly_rows(job: Job) -> list[Row]:
    """Kill the process that runs it, always, for one seed."""
    if job.trial.seed == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return fake_rows(job)


@pytest.mark.slow
def test_a_killed_process_of_the_pool_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STUDY_MARK", str(tmp_path / "mark"))
    run(SMALL, tmp_path / "killed", LocalPool(2), slow_rows)
    run(SMALL, tmp_path / "plain")
    assert (tmp_path / "mark").exists()
    assert comparable(SMALL, tmp_path / "killed") == comparable(SMALL, tmp_path / "plain")


@pytest.mark.slow
def test_trials_that_kill_every_process_are_reported(tmp_path: Path) -> None:
    first = dataclasses.replace(SMALL, objects=("box",), seeds=(1, 0, 2))
    with pytest.raises(EstimationError, match="2 trials"):
        run(first, tmp_path, LocalPool(2), deadly_rows)
    # All others were finished, although the deadly ones were first.
    assert len(keys_in(tmp_path)) == 2 * 2 * 2


REAL = Study(
    objects=("box", "sphere", "torus"),
    estimators=("gpis", "lis"),
    touches=(8,),
    noise=("none",),
    seeds=(0,),
    grasps=1,
)


@pytest.mark.slow
def test_a_job_runs_in_one_thread_whatever_the_environment_says() -> None:
    program = """
import lis_grasp_studies.study.run as trial
from threadpoolctl import threadpool_info

def rows(job):
    from lis_grasp.meshing import extract_mesh
    from lis_grasp.grasping.sampler import ForceClosureSampler
    import lis_grasp.simulation.drake.lift, lis_grasp.probing.kinematic_prober
    yield {library["filepath"]: library["num_threads"] for library in threadpool_info()}

trial.rows_of = rows
print(max(trial.run_trial(None)[0].values()))
"""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "2")
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | threads,
        check=True,
    )
    assert done.stdout == "1\n"


def test_jobs_of_one_process_run_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    at_work: list[int] = []
    most = []

    def rows(job: Job) -> Iterator[Row]:
        at_work.append(1)
        time.sleep(0.05)
        most.append(len(at_work))
        at_work.pop()
        yield {}

    monkeypatch.setattr(trial_module, "rows_of", rows)
    job = Job(SMALL.trials()[0], ("gpis",))
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(run_trial, [job] * 3))
    assert most == [1, 1, 1]


@pytest.mark.slow
def test_late_workers_help_and_jobs_of_dead_workers_are_repeated(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        results, first = StudyResults(tmp_path), next(iter(cluster.workers.values())).pid
        scheduler = DaskCluster(cluster.scheduler_address)
        steps = steps_of(SMALL, results, scheduler, rows_with_process)
        for done, _ in steps:
            if done == 1:
                cluster.scale(2)
            if done == 5:
                os.kill(first, signal.SIGKILL)
    rows = results.of(SMALL)
    assert len(rows) == len(SMALL.trials()) * len(SMALL.estimators)
    assert len({row["contacts_digest"] for row in rows}) >= 2  # the processes that made them


def rows_with_process(job: Job) -> list[Row]:
    """Return rows that name their process, not at once."""
    time.sleep(0.5)
    return [row | {"contacts_digest": str(os.getpid())} for row in fake_rows(job)]


@pytest.mark.slow
def test_rows_do_not_depend_on_the_scheduler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    run(REAL, tmp_path / "plain", InProcess(), run_trial)
    plain = comparable(REAL, tmp_path / "plain")
    assert {row["contacts_digest"] is not None for row in plain} == {True}
    for trial in REAL.trials():
        of_trial = [
            r for r in plain if (r["object"], r["touches"]) == (trial.object, trial.touches)
        ]
        assert len({row["contacts_digest"] for row in of_trial}) == 1
    assert any(row["held"] for row in plain)

    run(REAL, tmp_path / "pool", LocalPool(2), run_trial)
    assert comparable(REAL, tmp_path / "pool") == plain

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[2])]))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        results, killed = StudyResults(tmp_path / "dask"), False
        scheduler = DaskCluster(cluster.scheduler_address)
        for done, _ in steps_of(REAL, results, scheduler, run_trial):
            if done and not killed:
                killed = True
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
    assert killed
    assert comparable(REAL, tmp_path / "dask") == plain

    row = StudyResults(tmp_path / "plain").of(REAL)[0]
    (again,) = run_trial(job_of(row))
    assert without_times(again) == without_times(row)


@pytest.mark.slow
def test_an_unusable_cluster_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    with pytest.raises(InvalidOptionError, match="scheduler"):
        run(SMALL, tmp_path, DaskCluster("tcp://127.0.0.1:1"))
    monkeypatch.setattr("lis_grasp_studies.harness.runner._CONNECT", 2)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster,
        pytest.raises(InvalidOptionError, match="within 2 s"),
    ):
        run(SMALL, tmp_path, DaskCluster(cluster.scheduler_address))
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, dashboard_address=":0"
        ) as cluster,
        pytest.raises(InvalidOptionError, match="--nthreads 1"),
    ):
        run(SMALL, tmp_path, DaskCluster(cluster.scheduler_address))
