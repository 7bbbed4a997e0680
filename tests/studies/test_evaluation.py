"""The evaluation: order, time limit and continuation of its trials; numbers from its rows."""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline import RunConfig
from lis_grasp_studies.cli import evaluate
from lis_grasp_studies.evaluation import commands, configuration, results
from lis_grasp_studies.evaluation.configuration import KINDS, SHIPPED, Configuration
from lis_grasp_studies.evaluation.exploration import ExplorationTrial, measure_exploration
from lis_grasp_studies.evaluation.grasp_parts import GraspTrial, measure_grasps
from lis_grasp_studies.evaluation.grasp_tables import (
    attempts_table,
    beside_table,
    families_table,
    held_rate,
    ways_table,
)
from lis_grasp_studies.evaluation.part import Places, SeedsPart, interleaved
from lis_grasp_studies.evaluation.results import Evaluation, EvaluationResults
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.parquet import read_parquet
from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.harness.runner import InProcess
from lis_grasp_studies.harness.tables import Table
from lis_grasp_studies.study.columns import blank_row
from lis_grasp_studies.study.results import without_times
from lis_grasp_studies.study.run import run_trial
from lis_grasp_studies.study.trial import Setup, Trial
from lis_grasp_studies.test_objects.shape_sets import EVALUATION

pytest.importorskip("pyarrow", reason="needs lis-grasp[study]")

EVERYWHERE = Places(Path("meshes"), Path("other"))
CLOCK = [0.0]


@dataclass(frozen=True)
class Throw:
    object: str
    seed: int


def throw(trial: Throw, hand: str) -> Row:
    CLOCK[0] += 10.0
    return {"metres": trial.seed + len(trial.object) + len(hand)}


class ThrowsPart(SeedsPart):
    """Throws, each of ten seconds."""

    measure: Literal["throws"] = "throws"
    experiment: ClassVar[Experiment] = Experiment("throws", throw, asdict, variant="hand")

    def trials(self, seed: int, places: Places) -> Iterator[Any]:
        yield from (Throw(name, seed) for name in ("ball", "cup"))

    def tables(self, rows: Sequence[Row]) -> list[Table]:
        return [Table("throws", "Throws", ("rows",), ((str(len(rows)),),))]


def throws(monkeypatch: pytest.MonkeyPatch, seconds: float = 1.0) -> Configuration:
    """Return two parts of three and two rounds, whose time passes by a clock of their own."""
    monkeypatch.setitem(KINDS, "throws", ThrowsPart)
    monkeypatch.setattr(configuration, "time", SimpleNamespace(perf_counter=lambda: CLOCK[0]))
    monkeypatch.setattr(results, "time", SimpleNamespace(time=lambda: CLOCK[0]))
    facts: dict[str, Any] = {"title": "Throws", "variants": ["left", "right"]}
    first = ThrowsPart(seeds=[0, 1, 2], seconds=seconds, **facts)
    second = ThrowsPart(seeds=[5, 6], seconds=seconds, **facts)
    return Configuration.model_construct(parts={"first": first, "second": second})


def run(part: Configuration, folder: Path, hours: float | None = None, stop: int = 99) -> list[Row]:
    """Run until so many jobs are done; return the rows without what differs between equal runs."""
    steps = Evaluation(part, Places(), EvaluationResults(folder), InProcess(), hours).run()
    for done, _, _ in steps:
        if done == stop:
            break
    rows = EvaluationResults(folder).read()
    return [{k: v for k, v in row.items() if k not in ("job_seconds", "commit")} for row in rows]


def test_rounds_come_one_after_the_other_and_parts_in_their_order(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rows = run(throws(monkeypatch), tmp_path)
    order = list(dict.fromkeys((row["part"], row["seed"]) for row in rows))
    assert order == [("first", 0), ("second", 5), ("first", 1), ("second", 6), ("first", 2)]


def test_an_interrupted_evaluation_ends_with_the_rows_of_an_undisturbed_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    part = throws(monkeypatch)
    whole = run(part, tmp_path / "whole")
    assert len(whole) == 2 * 2 * 5
    assert len(run(part, tmp_path / "stopped", stop=3)) == 6
    with (tmp_path / "stopped" / "rows.jsonl").open("a") as file:
        file.write('{"part": "first", "obj')  # killed while it wrote
    assert run(part, tmp_path / "stopped") == whole
    lines = (tmp_path / "stopped" / "rows.jsonl").read_text().splitlines()
    assert len(lines) == 1 + len(whole)


def test_an_evaluation_continues_from_parquet_files_alone_without_loss(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    part, stored = throws(monkeypatch), EvaluationResults(tmp_path)
    assert len(run(part, tmp_path, stop=3)) == 6
    stored.write_parquet(part.ordered(stored.read()))
    stored.lines.path.unlink()
    (tmp_path / "rows" / ".partial-0.parquet").write_bytes(b"PAR1")  # killed while it wrote
    assert len(run(part, tmp_path, stop=5)) == 6 + 4
    empty = ThrowsPart(title="None", variants=["left"], seeds=[[]], seconds=1.0)
    assert not Configuration.model_construct(parts={"first": empty}).ordered(stored.read())
    stored.lines.path.unlink()
    monkeypatch.setattr(results, "__version__", "9.9.9")
    with pytest.raises(InvalidFileError) as error:
        stored.read()
    assert error.value.path == tmp_path / "rows"
    rows = stored.read(any_version=True)
    with (
        pytest.raises(InvalidFileError) as error,
        evaluate._known_columns([row | {"version": "1.0.0"} for row in rows], tmp_path),
    ):
        rows[0]["lifted"]
    assert error.value.path == tmp_path
    with pytest.raises(KeyError), evaluate._known_columns(rows, tmp_path):
        rows[0]["lifted"]  # an error of our own


@pytest.mark.parametrize(
    ("expected", "limit", "jobs"),
    [
        (1.0, 65.0, 3),  # a job takes 20 s, as the first shows: three are done in 65 s
        (1.0, 79.0, 3),
        (1.0, 81.0, 4),
        (50.0, 49.0, 0),  # before there are rows, the configuration says 50 s
        (50.0, 51.0, 2),
    ],
)
def test_a_job_that_would_not_be_done_in_time_is_not_begun(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, expected: float, limit: float, jobs: int
) -> None:
    part = throws(monkeypatch, expected)
    rows = run(part, tmp_path, hours=limit / 3600.0)
    # The second part is unknown when the first two jobs are done; 50 s are too long for it then.
    assert len(rows) == 2 * jobs


def test_scans_without_a_folder_are_left_out() -> None:
    known = Configuration.load(SHIPPED / "published.yaml", ["heavy", "surfaces", "grasps"])
    found, whole = (Counter(j.trial.part for j in known.jobs(p)) for p in (Places(), EVERYWHERE))
    assert not found["heavy"]
    assert whole["heavy"] == 2 * 2 * 6
    assert found["surfaces"] < whole["surfaces"]
    assert found["grasps"] < whole["grasps"]
    keys = {job.trial.key(job.variants[0]) for job in known.jobs(EVERYWHERE)}
    assert {job.trial.key(job.variants[0]) for job in known.jobs(Places())} < keys


@pytest.mark.parametrize("name", ["published", "quick"])
def test_every_beginning_of_the_shipped_trials_is_balanced(name: str) -> None:
    known = Configuration.load(SHIPPED / f"{name}.yaml")
    jobs = list(known.jobs(EVERYWHERE))
    cells = {part: Counter[str]() for part in known.parts}

    def cell(job: Job) -> str:
        facts = known.parts[job.trial.part].experiment.facts(job.trial.trial)
        return str({key: value for key, value in facts.items() if key != "seed"})

    for job in jobs:
        cells[job.trial.part][cell(job)] = 0
    for job in jobs:
        counts = cells[job.trial.part]
        counts[cell(job)] += 1
        assert max(counts.values()) - min(counts.values()) <= 1, job


def test_hands_in_turns_change_places_with_the_next_round() -> None:
    facts = {"title": "Grasps", "variants": ["blend"], "seconds": 1.0, "measure": "grasps"}
    objects = {"some": ["box", "pen.ply", "cup"]}
    part = KINDS["grasps"](
        objects=objects, hands=[{"a": 1, "b": 2}, {"a": 3, "b": 4}], turns=True, noise="none",
        budgets="5", **facts,
    )  # fmt: skip
    for places in (EVERYWHERE, Places()):  # without the scan, the others keep their hands
        rounds = [[task.trial for task in trials] for trials in part.rounds(places)]
        hands = [
            {Path(t.object).name: f"{t.hand}{t.seed}" for t in of if "pen" not in t.object}
            for of in rounds
        ]
        assert hands == [{"box": "a1", "cup": "a1"}, {"box": "b4", "cup": "b4"}]
    assert [t.trial.hand for t in part.rounds(EVERYWHERE)[0]] == ["a", "b", "a"]


def test_every_beginning_of_the_objects_has_of_each_group_its_fraction() -> None:
    groups = Configuration.load(SHIPPED / "published.yaml").parts["grasps"].objects
    total, counts = sum(map(len, groups.values())), Counter[str]()
    for group, _ in interleaved(groups):
        counts[group] += 1
        for name, members in groups.items():
            fraction = len(members) / total
            # Members are at the middles of equal intervals: each group is off by half a member.
            bound = 0.5 + 0.5 * len(groups) * fraction
            assert abs(counts[name] - counts.total() * fraction) <= bound + 1e-9


def test_the_published_trials_begin_with_the_most_important() -> None:
    jobs = list(Configuration.load(SHIPPED / "published.yaml").jobs(EVERYWHERE))
    order = [job.trial.part for job in jobs]
    assert list(dict.fromkeys(order))[:4] == ["grasps", "surfaces", "tasks", "hard"]
    once = [job.trial.trial.trial for job in jobs[: order.index("surfaces")]]
    assert Counter((trial.hand, trial.seed) for trial in once) == {
        ("allegro", 50): 20,
        ("wsg50", 54): 20,
    }
    assert len({trial.object for trial in once}) == 40
    seeds = [job.trial.trial.seed for job in jobs if job.trial.part == "surfaces"]
    assert order[: order.index("simulators")].count("surfaces") == len(seeds)


@pytest.mark.parametrize(("name", "hours"), [("published", 3.0), ("quick", 1 / 3)])
def test_shipped_configurations_take_the_time_that_they_promise(name: str, hours: float) -> None:
    known = Configuration.load(SHIPPED / f"{name}.yaml")
    seconds = sum(known.parts[job.trial.part].seconds for job in known.jobs(EVERYWHERE))
    assert seconds / 2.0 / 3600.0 <= hours  # on two cores
    objects = known.parts["surfaces"].objects
    assert objects == {family: list(names) for family, names in EVALUATION.items()}


def lifts(
    held: dict[str, list[int]], objects: Sequence[str] = ("cup", "pen"), closings: int = 0
) -> list[Row]:
    """Return a row for each estimator, object and seed, objects first."""
    facts = {"hand": "wsg50", "touches": 20, "noise": "none", "attempts": 1, "executed": 1}
    facts["closings"] = closings
    return [
        facts
        | {"object": objects[k % len(objects)], "seed": k // len(objects)}
        | {"estimator": name, "held": bool(value), "reason": "held" if value else "dropped"}
        for name, values in held.items()
        for k, value in enumerate(values)
    ]


def test_rates_and_tables_are_those_counted_by_hand() -> None:
    # Cups: blend 1 of 2, gpis 2 of 2. Pens: blend 2 of 2, gpis 1 of 2.
    rows = lifts({"blend": [1, 1, 0, 1], "gpis": [1, 0, 1, 1]})
    assert held_rate(rows) == 75.0
    groups = {"tools": ["pen"], "vessels": ["cup"]}
    body = families_table(rows, groups).body
    assert body[0] == ("vessels", "1", "50", "100", "−50.0")  # the loss first
    assert body[1] == ("tools", "1", "100", "50", "+50.0")
    assert body[2] == ("all", "2", "75", "75", "+0.0")
    pinched = [row | {"family": "rim" if row["object"] == "cup" else "pinch"} for row in rows]
    assert [line[0] for line in ways_table(pinched).body] == ["pinch", "rim"]
    assert ways_table(pinched).body[1][2:] == ("1 of 2", "2 of 2")
    assert not ways_table(rows).body  # of a version that named no family
    more = lifts({"blend": [1, 1, 1, 1]}, closings=5)
    (line,) = attempts_table([*rows, *more]).body
    assert line[:3] == ("blend", "1", "4")
    assert [line[3].split()[0], line[4].split()[0], line[5]] == ["75", "100", "+25.0"]
    failed = [more[0] | {"held": False, "reason": "failed", "executed": None}, *more[1:]]
    (line,) = attempts_table([*rows, *failed]).body
    assert (line[4].split()[0], line[6]) == ("75", "0.8")  # nothing was executed in one of four


def test_a_part_of_tested_grasps_alone_is_reported() -> None:
    known = Configuration.load(SHIPPED / "published.yaml").parts["grasps"]
    seeds = itertools.product(range(2), ("box", "pen"))
    rows = [
        blank_row(Trial(name, "wsg50", 10, "none", seed, Setup(closings=5)), estimator, shape)
        | {"held": bool(seed), "executed": 2, "reason": "held" if seed else "dropped"}
        for seed, name in seeds
        for shape in [Trial(name, "wsg50", 10, "none", 0).find_object()]
        for estimator in ("blend", "gpis")
    ]
    assert known.numbers(rows)["blend x1"] == known.numbers(rows)["blend"] == 50.0
    assert len(known.tables(rows)) == 8


def test_an_earlier_version_that_held_more_is_named() -> None:
    names = [f"cup{k}" for k in range(12)]
    now, before = ([1] * 2 + [0] * 10, [1] * 11 + [0])
    groups = {"vessels": names[:6], "others": names[6:]}
    body = beside_table(
        lifts({"blend": now, "gpis": before}, names), lifts({"blend": before}, names), groups
    ).body
    verdicts = {line[:2]: (line[2:5], line[-1]) for line in body}
    assert verdicts["blend", "all"] == (("12", "92", "17"), "clearly worse")
    assert verdicts["blend", "vessels"][0] == ("6", "100", "33")
    assert body[0][:2] == ("blend", "others")  # 5 of 6 lost, the most
    assert not any(line[0] == "GPIS" for line in body)  # the earlier version had none


TINY = """
shared: {one: &one [0]}
parts:
  paper:
    {measure: paper, title: Paper, experiments: [whole, wedge], variants: [lis, gpis, blend],
     seeds: *one, seconds: 3}
  exploration:
    {measure: exploration, title: Explorations, objects: {simple: [box]}, touches: "4 6",
     variants: [spread, "spread, slides"], seeds: [1], seconds: 5}
  lies:
    {measure: lies, title: Lies, objects: {simple: [gear]}, part: 10, fits: false,
     variants: [clean], seeds: [1], seconds: 1}
  grasps:
    {measure: grasps, title: Grasps, objects: {scans: [nowhere.ply]}, hands: [{wsg50: 0}],
     noise: none, budgets: "4", variants: [gpis, blend], seconds: 5}
"""


def call(*arguments: str) -> None:
    parser = argparse.ArgumentParser()
    evaluate.add_arguments(parser)
    with ExitStack() as stack:
        options = parser.parse_args(arguments)
        options.until_end = stack
        evaluate.execute(options)


@pytest.mark.slow
def test_one_command_measures_stores_and_reports(tmp_path: Path) -> None:
    file, output = tmp_path / "tiny.yaml", tmp_path / "out"
    file.write_text(TINY)
    call(str(file), "--jobs", "2", "--output", str(output))
    rows = EvaluationResults(output).read()
    assert {row["part"] for row in rows} == {"paper", "exploration", "lies"}  # no scan is there
    for name in ("paper", "exploration", "lies"):
        stored = read_parquet(output / "rows" / f"{name}.parquet")
        assert len(stored) == sum(row["part"] == name for row in rows)
    numbers = json.loads((output / "numbers.json").read_text())
    edges = numbers["paper"]
    assert edges["blend"] < edges["gpis"]
    page = (output / "results.md").read_text()
    assert f"{edges['blend']:.1f} mm (blend)" in page
    assert "of 16 of 17 trials" in page
    assert "data:image/png;base64," in (output / "report.html").read_text()
    # A stop after any trial leaves a part that can be reported.
    known = Configuration.load(file)
    for name, ordered in known.ordered(rows).items():
        part = known.parts[name]
        for count in range(1, len(ordered), 3):
            part.tables(ordered[:count]), part.answers(ordered[:count])
            part.numbers(ordered[:count])
    # The Parquet files alone give the same page.
    (output / "rows.jsonl").unlink()
    file.unlink()
    call("--report-only", "--output", str(output))
    assert json.loads((output / "numbers.json").read_text()) == numbers


def test_memory_of_a_command_is_not_that_of_the_process_that_starts_it(tmp_path: Path) -> None:
    ballast = np.ones(2**25)
    row = commands._run([sys.executable, "-c", "b'1' * 2**26"], str(tmp_path), dict(os.environ))
    assert 64 < row["memory"] < ballast.nbytes / 2**20
    assert row["wall"] > 0.0 < row["processor"]


def test_mistakes_are_named(tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    for text, field in (
        (TINY.replace("seconds: 3", "seconds: 0"), "parts.paper.paper.seconds"),
        (TINY.replace("measure: lies", "measure: truths"), "parts.lies.measure"),
        (TINY.replace("part: 10", "parts: 10"), "parts.lies.lies.part"),
        (TINY.replace("  lies:", "  ../lies:"), "parts.../lies.[key]"),
        ("parts: {}", "parts"),
        ("[]", ""),
    ):
        file.write_text(text)
        with pytest.raises(InvalidFileError) as error:
            Configuration.load(file)
        assert (error.value.path, error.value.field) == (file, field)
    file.write_text(TINY)
    with pytest.raises(InvalidOptionError) as error:
        call(str(file), "--parts", "grasp")
    assert (error.value.option, error.value.value) == ("--parts", "grasp")
    for option, value in (("--hours", "0"), ("--meshes", "no"), ("--beside", str(tmp_path))):
        with pytest.raises(InvalidOptionError) as error:
            call(str(file), option, value, "--output", str(tmp_path / "out"))
        assert error.value.option == option


@pytest.mark.slow
def test_budgets_give_the_rows_of_the_study_s_trials() -> None:
    setup = Setup(size=0.08)
    task = GraspTrial(Trial("box", "wsg50", 1, "none", 0, setup), "6 9 9x2", ("blend",))
    rows = measure_grasps(task, "blend")
    assert [(row["touches"], row["attempts"]) for row in rows] == [(6, 1), (9, 1), (9, 2)]
    (alone,) = run_trial(Job(Trial("box", "wsg50", 9, "none", 0, setup), ("blend",)))
    assert without_times(rows[1]) == without_times(alone)
    assert rows[2]["contacts_digest"] == alone["contacts_digest"]
    assert 1 <= rows[2]["executed"] <= 2 * (1 + RunConfig().closings)
    planned = measure_grasps(task, "truth")  # the task names no tests for it
    assert [row["closings"] for row in planned] == [0, 0]
    assert planned[1]["rmsd"] < 1e-9


def test_rows_of_explorations_are_after_touches_with_and_without_slides() -> None:
    trial = ExplorationTrial("box", 1, "3 5")
    with_slides = measure_exploration(trial, "spread, slides")
    without = measure_exploration(trial, "spread")
    assert [row["count"] for row in (*with_slides, *without)] == [3, 5, 3, 5]
    assert [row["contacts"] for row in without] == [3, 5]
    assert with_slides[1]["contacts"] > 5
    assert with_slides[1]["probes"] >= 5


@pytest.mark.slow
def test_a_long_exploration_of_a_detailed_part_gets_better_to_the_end() -> None:
    rows = measure_exploration(ExplorationTrial("gear", 0, "40 80 160"), "spread")
    errors = [row["rmsd_truth_to_estimate"] for row in rows]
    assert errors[2] < min(errors[:2])  # one new touch may mislead for a while
    # N contacts are about 1 / sqrt(N) apart: the error falls faster than the root of that.
    assert errors[2] < errors[0] * (40 / 160) ** 0.25
