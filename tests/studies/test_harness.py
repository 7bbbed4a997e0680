"""The harness of the experiments: rows that are made once, tables of groups, command lines."""

from __future__ import annotations

import os
import pickle
from dataclasses import dataclass
from pathlib import Path

import pytest

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.score import SURFACES
from lis_grasp_studies.evaluation.simulators import SIMULATIONS
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import Table, grouped_table, mean_cell, split, where
from lis_grasp_studies.paper.trials import PAPER


@dataclass(frozen=True)
class Throw:
    object: str
    seed: int


def distance(throw: Throw, hand: str) -> Row:
    return {"metres": throw.seed + len(hand), "process": os.getpid()}


def two_distances(throw: Throw, hand: str) -> list[Row]:
    return [{"metres": throw.seed}, {"metres": -throw.seed}]


THROWS = [Throw(name, seed) for seed in (0, 1) for name in ("ball", "cup")]


@pytest.mark.parametrize("jobs", [1, 2])
def test_rows_come_in_the_order_of_trials_and_are_made_once(tmp_path: Path, jobs: int) -> None:
    experiment = Experiment("throws", distance, variant="hand")
    file = tmp_path / "rows.jsonl"
    first = experiment.complete(THROWS[:1], ["left"], file, jobs=jobs)
    rows = experiment.complete(THROWS, ["left", "right"], file, jobs=jobs)
    places = [(row["object"], row["seed"], row["hand"]) for row in rows]
    assert places == [(t.object, t.seed, hand) for t in THROWS for hand in ("left", "right")]
    assert rows[0] == first[0]
    assert len(file.read_text().splitlines()) == 1 + len(rows)


def test_a_trial_may_have_several_rows_of_one_variant(tmp_path: Path) -> None:
    experiment = Experiment("throws", two_distances, variant="hand")
    rows = experiment.complete(THROWS[2:], ["left"], tmp_path / "rows.jsonl", jobs=1)
    assert [row["metres"] for row in rows] == [1, -1, 1, -1]


def test_a_variant_whose_source_changed_is_measured_again(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    for digest in ("a", "b"):
        experiment = Experiment("throws", distance, variant="hand", source=lambda _, d=digest: d)
        (row,) = experiment.complete(THROWS[:1], ["left"], file, jobs=1)
        assert row["source"] == digest
    assert len(file.read_text().splitlines()) == 3


@pytest.mark.parametrize("experiment", [PAPER, SURFACES, SIMULATIONS])
def test_other_processes_can_run_every_experiment(experiment: Experiment) -> None:
    assert pickle.loads(pickle.dumps(experiment.run)).__self__ == experiment  # noqa: S301


def test_a_table_has_a_line_for_each_group_with_rows() -> None:
    rows = [{"a": "x", "b": 1, "v": 0.001}, {"a": "x", "b": 1, "v": 0.003}]
    rows += [{"a": "y", "b": 2, "v": None}]
    groups = {**split(rows, "a", "b"), ("z", 3): where(rows, a="z")}
    table = grouped_table("t", "Title", "a | b", groups, [("mean [mm]", mean_cell("v", 1e3))])
    assert table.head == ("a", "b", "mean [mm]")
    assert table.body == (("x", "1", "2.0"), ("y", "2", "–"))
    assert table.text().splitlines()[:3] == ["Title", "a  b  mean [mm]", "x  1        2.0"]


@pytest.mark.parametrize(
    ("choice", "lines"),
    [
        ("", ["x 1", "x 2", "y 1"]),
        ("first 1", ["x 1"]),
        ("y; 2", ["x 2", "y 1"]),
        ("a=x | b=1; 3", ["x 1"]),
        ("x | first 1", ["x 1"]),
        ("columns b | x", ["1", "2"]),
        ("columns b; a | first 1", ["1 x"]),
        ("columns c", []),
        ("a=1", []),  # of another column
        ("c=1", []),
    ],
)
def test_some_lines_of_a_table_are_chosen_by_their_cells(choice: str, lines: list[str]) -> None:
    table = Table("t", "Title", ("a", "b"), (("x", "1"), ("x", "2"), ("y", "1")))
    if lines:
        shown = format(table, choice).splitlines()[2:]
        assert shown == [f"| {' | '.join(line.split())} |" for line in lines]
    else:
        with pytest.raises(ValueError, match="."):
            format(table, choice)


def test_options_have_the_types_of_their_defaults() -> None:
    words = ["a", "b", "--seeds", "3", "--masses", "0.1", "0.2", "--free", "--output", "out"]
    defaults = {"objects": ["box"], "seeds": 1, "masses": [0.5], "free": False, "jobs": int}
    options = read_options("Help.", words, **defaults, output=Path("results"))
    assert options.objects == ["a", "b"]
    assert (options.seeds, options.masses, options.free) == (3, [0.1, 0.2], True)
    assert (options.jobs, options.output) == (None, Path("out"))
    assert read_options("Help.", [], **defaults).objects == ["box"]
