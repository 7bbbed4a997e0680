"""Studies: what is permitted, that rows last, and that they do not depend on who makes them."""

from __future__ import annotations

import dataclasses
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

from lis_grasp import pipeline, shapes
from lis_grasp.exceptions import EstimationError, InvalidFileError, InvalidOptionError
from lis_grasp.experiments.study import study_trial as trial_module
from lis_grasp.experiments.study.attempt import Attempt, attempt
from lis_grasp.experiments.study.exploring import contacts_of, forget
from lis_grasp.experiments.study.keys import row_key
from lis_grasp.experiments.study.scheduling import DaskCluster, InProcess, LocalPool, run_study
from lis_grasp.experiments.study.study import Setup, Study, Trial, parse_noise
from lis_grasp.experiments.study.study_file import load_study
from lis_grasp.experiments.study.study_results import COLUMNS, StudyResults, job_of, without_times
from lis_grasp.experiments.study.study_trial import Job, run_job
from lis_grasp.exploration import Exploration
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.hands.hand import Hand
from lis_grasp.io.json_lines import Row

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
        trial_module._blank_row(job.trial, job.setup, name, shapes.build(job.trial.object))
        | {"rmsd": 0.1 + 0.2 * job.trial.seed, "contacts": job.trial.touches, "seconds_touch": 1.0}
        for name in job.estimators
    ]


def run(study: Study, folder: Path, scheduler: object = None, runner: object = fake_rows) -> int:
    results = StudyResults(folder)
    steps = list(run_study(study, results, scheduler or InProcess(), runner=runner))  # type: ignore[arg-type]
    return len(steps) - 1


def comparable(study: Study, folder: Path) -> list[Row]:
    return [without_times(row) for row in StudyResults(folder).of(study)]


def test_a_study_is_all_with_all_and_seed_by_seed() -> None:
    trials = SMALL.trials()
    assert len(trials) == len(set(trials)) == 2 * 2 * 1 * 1 * 2
    assert [trial.seed for trial in trials] == sorted(trial.seed for trial in trials)


def test_a_study_comes_back_from_its_facts() -> None:
    study = dataclasses.replace(SMALL, setup=Setup(explorer="own", policy="frontier", grasps=3))
    assert Study.from_facts(study.facts()) == study
    assert Study.from_facts({"seeds": 3}).seeds == (0, 1, 2)


def test_a_study_is_read_from_yaml(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text("objects: [box]\nnoise: [none, 1mm/3deg]\nseeds: 2\nmass: 0.3\n")
    study = Study.from_facts(load_study(path))
    assert study.objects == ("box",)
    assert study.noise == ("none", "1mm/3deg")
    assert study.setup.mass == 0.3


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"object": ["box"]}, "did you mean 'objects'"),
        ({"objects": "box"}, "objects must be a list"),
        ({"objects": []}, "objects must name at least one"),
        ({"objects": ["bx"]}, "neither a built-in shape"),
        ({"estimators": ["gpis", "blnd"]}, "did you mean 'blend'"),
        ({"estimators": ["blend"]}, "compares with 'gpis'"),
        ({"touches": [0]}, "touches must be whole numbers from 1 on; 0 came"),
        ({"touches": [10, 10]}, "10 came twice"),
        ({"seeds": 0}, "seeds must be at least 1"),
        ({"seeds": [-1]}, "seeds must be whole numbers from 0 on"),
        ({"noise": ["1mm"]}, "noise must be 'none' or like '1mm/3deg'"),
        ({"hands": ["claw"]}, "claw"),
        ({"prober": "none"}, "prober must be one of"),
        ({"explorer": "own"}, "a policy that follows them"),
        ({"policy": "psychic"}, "policy must be one of spread"),
        ({"explorer": "gps"}, "did you mean 'gpis'"),
        ({"noise": [{"position": 0.001}]}, "noise must be names"),
        ({"hands": [3]}, "hands must be names; 3 came"),
        ({"touches": [1.5]}, "touches must be whole numbers; 1.5 came"),
        ({"mass": "heavy"}, "mass must be a number"),
        ({"mass": -1.0}, "mass must be a positive number"),
        ({"grasps": 1.5}, "grasps must be a whole number"),
        ({"grasps": True}, "grasps must be a whole number"),
        ({"mass": True}, "mass must be a number"),
        ({"mass": 10**400}, "mass must be"),
        ({"units": "furlong"}, "units must be among m, cm"),
        ({"seeds": [2**63]}, "seeds must be less than 2"),
    ],
)
def test_a_mistake_in_a_study_is_named(facts: dict, message: str) -> None:
    with pytest.raises(Exception, match=message) as caught:
        Study.from_facts(facts)
    assert type(caught.value).__module__ == "lis_grasp.exceptions"


@pytest.mark.parametrize(
    ("text", "message"),
    [("objects: [box", "must be a YAML file"), ("- box", "must hold keys and values")],
)
def test_another_file_is_no_study(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(text)
    with pytest.raises(InvalidFileError, match=message):
        load_study(path)
    with pytest.raises(InvalidFileError, match="cannot read"):
        load_study(tmp_path / "none.yaml")


def test_noise_is_in_metres_and_radians() -> None:
    assert not parse_noise("none").any
    assert parse_noise("1mm/3deg").position == pytest.approx(1e-3)
    assert parse_noise("0.5mm/3deg").normal == pytest.approx(np.pi / 60)


def test_a_key_names_all_that_decides_a_row() -> None:
    trial, setup = Trial("box", "allegro", 10, "none", 0), Setup()
    others = [
        row_key(dataclasses.replace(trial, **{name: value}), setup, "gpis")
        for name, value in (
            ("object", "torus"),
            ("hand", "wsg50"),
            ("touches", 11),
            ("noise", "1mm/3deg"),
            ("seed", 1),
        )
    ]
    others += [row_key(trial, setup, "lis"), row_key(trial, Setup(mass=0.3), "gpis")]
    assert len({row_key(trial, setup, "gpis"), *others}) == len(others) + 1
    assert row_key(trial, setup, "gpis") == row_key(trial, Setup(), "gpis")


def test_whole_numbers_are_numbers_in_a_key() -> None:
    facts = {"mass": 1, "friction": 1, "size": 1, "grasps": 2}
    whole, real = (Study.from_facts(SMALL.facts() | facts | more) for more in ({}, {"mass": 1.0}))
    trial = whole.trials()[0]
    assert row_key(trial, whole.setup, "gpis") == row_key(trial, real.setup, "gpis")
    (row,) = fake_rows(Job(trial, whole.setup, ("gpis",)))
    # As Parquet gives them back.
    assert job_of(row | {"mass": 1.0, "friction": 1.0, "size": 1.0}).setup == whole.setup


def test_a_file_counts_by_what_is_in_it(tmp_path: Path) -> None:
    path = tmp_path / "block.stl"
    trial = Trial(str(path), "allegro", 10, "none", 0)
    keys = set()
    for size in (0.10, 0.12, 0.10):
        shapes.build("box", size).mesh.export(path)
        keys.add(row_key(trial, Setup(), "gpis"))
    assert len(keys) == 2


def exported_block(folder: Path, *, size: float = 0.10) -> Path:
    folder.mkdir(exist_ok=True)
    shapes.build("box", size).mesh.export(folder / "block.stl")
    return folder / "block.stl"


def test_a_study_of_the_same_file_in_another_folder_is_the_same_study(tmp_path: Path) -> None:
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
    return [trial_module._blank_row(job.trial, job.setup, name, shape) for name in job.estimators]


def test_a_row_of_a_file_is_made_again_from_the_file_of_that_content(tmp_path: Path) -> None:
    block = exported_block(tmp_path / "here")
    trial = Trial(str(block), "allegro", 6, "none", 0)
    (row,) = named_rows(Job(trial, Setup(), ("gpis",)))
    assert job_of(row, [str(block)]) == Job(trial, Setup(), ("gpis",))
    with pytest.raises(InvalidOptionError, match=r"the row is of the file block\.stl"):
        job_of(row)
    exported_block(tmp_path / "here", size=0.12)
    with pytest.raises(InvalidOptionError, match="has changed since"):
        job_of(row, [str(block)])


def test_a_process_that_goes_on_sees_that_a_file_has_changed(tmp_path: Path) -> None:
    def reach(size: float) -> float:
        block = exported_block(tmp_path, size=size)
        trial = Trial(str(block), "allegro", 6, "none", 0)
        contacts, _ = contacts_of(trial, Setup(), "blend")
        return float(np.abs(contacts.points).max())

    assert reach(0.14) > 1.2 * reach(0.10)
    # So with a hand's: attempts on one mesh differ where the hand's files do.
    box, hand = shapes.build("box"), Hand.load("allegro")
    a, b = (
        Attempt("mesh", "box", "own.yaml", (digest,), 0, Setup(), box.mesh, box, hand)
        for digest in ("a", "b")
    )
    assert a != b


def test_files_of_a_study_are_found_from_its_folder_or_among_the_meshes(tmp_path: Path) -> None:
    block = exported_block(tmp_path / "shapes")
    path = tmp_path / "study.yaml"
    path.write_text("objects: [box, shapes/block.stl]\n")
    assert load_study(path)["objects"] == ["box", str(block)]
    path.write_text("objects: [box, block.stl]\n")
    assert load_study(path, block.parent)["objects"] == ["box", str(block)]
    Study.from_facts(load_study(path, block.parent))
    with pytest.raises(InvalidFileError, match="is missing, or is no file"):
        Study.from_facts(load_study(path)).require_files()


def test_files_of_one_name_are_refused(tmp_path: Path) -> None:
    both = tuple(str(exported_block(tmp_path / name)) for name in ("here", "there"))
    with pytest.raises(InvalidOptionError, match=r"differ by name.*block\.stl"):
        dataclasses.replace(SMALL, objects=both)


def test_a_study_goes_on_from_the_merged_file_alone(tmp_path: Path) -> None:
    half = dataclasses.replace(SMALL, seeds=(0,))
    run(half, tmp_path / "first")
    merged = StudyResults(tmp_path / "first").write_merged()
    (tmp_path / "second").mkdir()
    merged.rename(tmp_path / "second" / "rows.parquet")
    results = StudyResults(tmp_path / "second")
    assert {job.trial.seed for job in results.missing(SMALL)} == {1}
    run(SMALL, tmp_path / "second")
    run(SMALL, tmp_path / "whole")
    assert results.of(SMALL) == StudyResults(tmp_path / "whole").of(SMALL)
    # Merging again loses nothing, whoever wrote it.
    results.write_merged()
    assert results.read() == StudyResults(tmp_path / "whole").read()


def test_every_contender_can_be_studied_but_those_that_cannot_run() -> None:
    names = ("gpis", "gpis_rbf", "gpis_thin_plate", "hermite_rbf", "patch", "truth")
    assert dataclasses.replace(SMALL, estimators=names).estimators == names
    with pytest.raises(InvalidOptionError, match="did you mean 'gpis_rbf'"):
        dataclasses.replace(SMALL, estimators=("gpis", "gpis_rfb"))
    own = Setup(explorer="own", policy="frontier")
    with pytest.raises(InvalidOptionError, match="estimators must be among lis, gpis"):
        dataclasses.replace(SMALL, estimators=("gpis", "hermite_rbf"), setup=own)


def test_an_estimator_whose_package_is_missing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(InvalidOptionError, match="which is not installed"):
        dataclasses.replace(SMALL, estimators=("gpis", "rimls"))


def test_rows_are_reported_on_without_any_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block = exported_block(tmp_path / "here")
    study = dataclasses.replace(SMALL, objects=("box", str(block)))
    run(study, tmp_path, runner=named_rows)
    rows = StudyResults(tmp_path).of(study)
    block.unlink()
    elsewhere = dataclasses.replace(study, objects=("box", "/nowhere/block.stl"))
    with monkeypatch.context() as later:
        later.setattr("lis_grasp.__version__", "9.9.9")
        assert StudyResults(tmp_path).alike(elsewhere) == rows
        assert StudyResults(tmp_path).alike(dataclasses.replace(study, setup=Setup(mass=0.3))) == []
    with pytest.raises(InvalidFileError, match=r"cannot read /nowhere/block\.stl"):
        StudyResults(tmp_path).missing(elsewhere)


def test_rows_of_two_files_of_one_name_are_not_mixed(tmp_path: Path) -> None:
    for size in (0.10, 0.12):
        block = exported_block(tmp_path / "here", size=size)
        study = dataclasses.replace(SMALL, objects=(str(block),))
        run(study, tmp_path, runner=named_rows)
    with pytest.raises(InvalidFileError, match=r"has two of block\.stl"):
        StudyResults(tmp_path).alike(study)


def test_rows_come_back_as_they_were_written(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    written = [
        row for job in StudyResults(tmp_path / "no").missing(SMALL) for row in fake_rows(job)
    ]
    assert StudyResults(tmp_path).of(SMALL) == [{n: r.get(n) for n in COLUMNS} for r in written]
    merged = StudyResults(tmp_path).write_merged()
    assert merged.is_file()
    assert len(StudyResults(tmp_path).keys()) == len(written)


def test_columns_are_those_of_a_row() -> None:
    row = fake_rows(Job(SMALL.trials()[0], Setup(), ("gpis",)))[0]
    assert set(row) | set(trial_module.TIMES) == set(COLUMNS)


def test_an_interrupted_study_goes_on_where_it_was(tmp_path: Path) -> None:
    asked: list[Job] = []

    def counting(job: Job) -> list[Row]:
        asked.append(job)
        if len(asked) == 4:
            raise KeyboardInterrupt
        return fake_rows(job)

    with pytest.raises(KeyboardInterrupt):
        run(SMALL, tmp_path, runner=counting)
    assert len(StudyResults(tmp_path).keys()) == 3 * 2
    (tmp_path / "rows" / ".partial-torn.parquet").write_bytes(b"PAR1")  # killed while writing
    run(SMALL, tmp_path, runner=counting)
    # Nothing is done twice but the trial that was cut off.
    assert len(asked) == len(SMALL.trials()) + 1
    assert run(SMALL, tmp_path) == 0
    run(SMALL, tmp_path / "whole")
    assert comparable(SMALL, tmp_path) == comparable(SMALL, tmp_path / "whole")


def test_an_estimator_added_later_runs_alone(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    more = dataclasses.replace(SMALL, estimators=("gpis", "blend", "lis"))
    assert {job.estimators for job in StudyResults(tmp_path).missing(more)} == {("lis",)}


def test_a_row_of_another_version_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(SMALL, tmp_path)
    monkeypatch.setattr("lis_grasp.__version__", "9.9.9")
    with pytest.raises(InvalidFileError, match="must be of lis_grasp 9.9.9"):
        StudyResults(tmp_path).of(SMALL)


def test_rows_that_could_not_stay_are_refused_before_the_work_and_as_they_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def outdated(job: Job) -> list[Row]:
        return [row | {"version": "0.0.9"} for row in fake_rows(job)]

    with pytest.raises(InvalidFileError, match=r"made one of 0\.0\.9: give all workers"):
        run(SMALL, tmp_path, runner=outdated)
    assert not StudyResults(tmp_path).keys()
    run(dataclasses.replace(SMALL, seeds=(0,)), tmp_path)
    monkeypatch.setattr("lis_grasp.__version__", "9.9.9")
    with pytest.raises(InvalidFileError, match=r"must be of lis_grasp 9\.9\.9"):
        run(SMALL, tmp_path, runner=lambda _: pytest.fail("nothing is to be run"))


def test_an_error_that_nobody_foresaw_stops_one_trial_and_no_other(tmp_path: Path) -> None:
    def mistaken(job: Job) -> list[Row]:
        if (job.trial.object, job.trial.touches) == ("box", 6):
            raise ZeroDivisionError("nobody foresaw it")
        return fake_rows(job)

    with pytest.raises(EstimationError, match="2 trials met a mistake") as caught:
        run(SMALL, tmp_path, runner=mistaken)
    assert "ZeroDivisionError: nobody foresaw it" in str(caught.value)
    assert len(StudyResults(tmp_path).missing(SMALL)) == 2
    # What can be foreseen, a file that went missing, stops the study at once.
    gone = InvalidFileError("gone")

    def unreadable(_: Job) -> list[Row]:
        raise gone

    with pytest.raises(InvalidFileError) as caught_file:
        run(SMALL, tmp_path, runner=unreadable)
    assert caught_file.value is gone


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    path = sorted((tmp_path / "rows").iterdir())[0]
    path.write_bytes(path.read_bytes()[:50])
    with pytest.raises(InvalidFileError, match="remove it, and it is made again"):
        StudyResults(tmp_path).read()


def test_a_row_is_found_by_the_beginning_of_its_key(tmp_path: Path) -> None:
    run(SMALL, tmp_path)
    results = StudyResults(tmp_path)
    row = results.of(SMALL)[3]
    assert results.row(row["key"][:8]) == row
    assert row_key(job_of(row).trial, job_of(row).setup, row["estimator"]) == row["key"]
    for key, count in (("", 16), ("nothing", 0)):
        with pytest.raises(InvalidOptionError, match=f"names {count}"):
            results.row(key)


def test_a_smaller_budget_s_contacts_are_the_first_of_a_larger_one() -> None:
    larger = Trial("mallet", "allegro", 14, "1mm/3deg", 3)
    forget()
    many, _ = contacts_of(larger, Setup(), "blend")
    few, _ = contacts_of(dataclasses.replace(larger, touches=9), Setup(), "blend")
    assert (len(few), len(many)) == (9, 14)
    np.testing.assert_array_equal(few.points, many.points[:9])
    np.testing.assert_array_equal(few.normals, many.normals[:9])
    free = len(few.free_points)
    np.testing.assert_array_equal(few.free_points, many.free_points[:free])


def test_a_larger_budget_goes_on_from_a_smaller_one(monkeypatch: pytest.MonkeyPatch) -> None:
    smaller = Trial("hollow_cylinder", "wsg50", 5, "1mm/3deg", 2)
    larger = dataclasses.replace(smaller, touches=11)
    forget()
    whole, _ = contacts_of(larger, Setup(), "blend")
    forget()
    _, before = contacts_of(smaller, Setup(), "blend")
    given = []
    touch = pipeline.touch

    def spy(*arguments: Any, **options: Any) -> Exploration:
        given.append(len(options["recorded"]))
        return touch(*arguments, **options)

    monkeypatch.setattr(pipeline, "touch", spy)
    grown, after = contacts_of(larger, Setup(), "blend")
    assert given[0] >= 5
    assert after > before
    np.testing.assert_array_equal(grown.points, whole.points)
    np.testing.assert_array_equal(grown.normals, whole.normals)
    np.testing.assert_array_equal(grown.free_points, whole.free_points)


def test_what_is_planned_on_one_mesh_is_planned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    planned = []
    plan = pipeline.plan

    def spy(*arguments: Any, **options: Any) -> GraspSearch:
        planned.append(options["seed"])
        return plan(*arguments, **options)

    monkeypatch.setattr(pipeline, "plan", spy)
    attempt.cache_clear()
    first, second = (Trial("sphere", "wsg50", touches, "none", 5) for touches in (5, 6))
    rows = [run_job(Job(trial, Setup(), ("truth", "patch"))) for trial in (first, second)]
    assert len(planned) == 3  # the truth once, the patches of 5 and of 6 contacts
    for name in ("held", "epsilon_truth", "slip", "rejections"):
        assert rows[0][0][name] == rows[1][0][name]
    assert rows[0][0]["contacts"] != rows[1][0]["contacts"]


def test_failures_are_rows_with_their_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def estimate(*_: object) -> None:
        raise EstimationError("no surface of this kind")

    monkeypatch.setattr(trial_module, "contender", lambda _: estimate)
    (row,) = run_job(Job(Trial("box", "allegro", 4, "none", 0), Setup(), ("gpis",)))
    assert (row["reason"], row["held"]) == ("failed", False)
    assert row["failure"] == "EstimationError: no surface of this kind"
    assert row["contacts"] == 4


def test_an_object_that_was_never_felt_is_a_failure_of_its_trial(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from lis_grasp.contacts import Contacts

    forget()
    monkeypatch.setattr(pipeline, "touch", lambda *_, **__: Exploration(Contacts.empty(), ()))
    (row,) = run_job(Job(Trial("box", "allegro", 4, "none", 99), Setup(), ("gpis",)))
    forget()
    assert "the exploration made none" in row["failure"]


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
    with pytest.raises(EstimationError, match="2 trials were not finished"):
        run(first, tmp_path, LocalPool(2), deadly_rows)
    # All others were, though the deadly ones came first.
    assert len(StudyResults(tmp_path).keys()) == 2 * 2 * 2


REAL = Study(
    objects=("box", "sphere", "torus"),
    estimators=("gpis", "lis"),
    touches=(8,),
    noise=("none",),
    seeds=(0,),
)


def test_a_job_runs_in_one_thread_whatever_the_process_was_started_with() -> None:
    program = """
import lis_grasp.experiments.study.study_trial as trial
from threadpoolctl import threadpool_info

def rows(job):
    from lis_grasp.meshing import extract_mesh
    from lis_grasp.grasping.sampler import ForceClosureSampler
    import lis_grasp.simulation.simulate_lift, lis_grasp.probing.kinematic_prober
    yield {library["filepath"]: library["num_threads"] for library in threadpool_info()}

trial._rows = rows
print(max(trial.run_job(None)[0].values()))
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


def test_jobs_of_one_process_wait_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    at_work: list[int] = []
    most = []

    def rows(job: Job) -> Iterator[Row]:
        at_work.append(1)
        time.sleep(0.05)
        most.append(len(at_work))
        at_work.pop()
        yield {}

    monkeypatch.setattr(trial_module, "_rows", rows)
    job = Job(SMALL.trials()[0], Setup(), ("gpis",))
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(run_job, [job] * 3))
    assert most == [1, 1, 1]


@pytest.mark.slow
def test_a_worker_that_joins_late_works_and_one_that_dies_is_made_up_for(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        results, first = StudyResults(tmp_path), next(iter(cluster.workers.values())).pid
        steps = run_study(
            SMALL, results, DaskCluster(cluster.scheduler_address), runner=who_made_them
        )
        for done, _ in steps:
            if done == 1:
                cluster.scale(2)
            if done == 5:
                os.kill(first, signal.SIGKILL)
    rows = results.of(SMALL)
    assert len(rows) == len(SMALL.trials()) * len(SMALL.estimators)
    assert len({row["contacts_digest"] for row in rows}) >= 2  # the processes that made them


def who_made_them(job: Job) -> list[Row]:
    """Return rows that name their process, not at once."""
    time.sleep(0.5)
    return [row | {"contacts_digest": str(os.getpid())} for row in fake_rows(job)]


@pytest.mark.slow
def test_rows_are_equal_whoever_makes_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    run(REAL, tmp_path / "plain", InProcess(), run_job)
    plain = comparable(REAL, tmp_path / "plain")
    assert {row["contacts_digest"] is not None for row in plain} == {True}
    for trial in REAL.trials():
        of_trial = [
            r for r in plain if (r["object"], r["touches"]) == (trial.object, trial.touches)
        ]
        assert len({row["contacts_digest"] for row in of_trial}) == 1
    assert any(row["held"] for row in plain)

    run(REAL, tmp_path / "pool", LocalPool(2), run_job)
    assert comparable(REAL, tmp_path / "pool") == plain

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[2])]))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        results, killed = StudyResults(tmp_path / "dask"), False
        for done, _ in run_study(REAL, results, DaskCluster(cluster.scheduler_address)):
            if done and not killed:
                killed = True
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
    assert killed
    assert comparable(REAL, tmp_path / "dask") == plain

    row = StudyResults(tmp_path / "plain").of(REAL)[0]
    (again,) = run_job(job_of(row))
    assert without_times(again) == without_times(row)


@pytest.mark.slow
def test_a_cluster_that_cannot_be_used_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    with pytest.raises(InvalidOptionError, match="address of a running Dask scheduler"):
        run(SMALL, tmp_path, DaskCluster("tcp://127.0.0.1:1"))
    monkeypatch.setattr("lis_grasp.experiments.study.scheduling._CONNECT", 2)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as cluster,
        pytest.raises(InvalidOptionError, match="had none for 2 s: start some with dask worker"),
    ):
        run(SMALL, tmp_path, DaskCluster(cluster.scheduler_address))
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, dashboard_address=":0"
        ) as cluster,
        pytest.raises(InvalidOptionError, match="must have one thread each"),
    ):
        run(SMALL, tmp_path, DaskCluster(cluster.scheduler_address))
