"""The paper's experiments: what a trial is, results that survive interruption, what they say."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidFileError
from lis_grasp.experiments.compared_estimators import OURS, Noise
from lis_grasp.experiments.paper.paper_results import ResultsFile, run_trials
from lis_grasp.experiments.paper.paper_trials import Trial, run_trial, trials
from lis_grasp.experiments.paper.summary import tabulate
from lis_grasp.experiments.paper.wedge import NOISE_LEVELS, touch_wedge, wedge
from lis_grasp.surfaces import PatchImplicitSurface

WEDGE = [Trial("wedge", "0", 0), Trial("wedge", "2", 0), Trial("wedge", "2", 1)]


def as_lines(path: Path) -> list[str]:
    return sorted(path.read_text().splitlines())


def test_contacts_of_the_wedge_lie_on_its_two_faces() -> None:
    contacts, cube = touch_wedge(), wedge()
    assert len(contacts) == 12
    x, z = contacts.points[:, 0], contacts.points[:, 2]
    np.testing.assert_allclose(x * z, 0.0, atol=1e-15)
    assert (np.minimum(x, z) < 0).all()
    np.testing.assert_allclose(np.where(contacts.normals[:, 0] > 0.5, x, z), 0.0, atol=1e-15)
    apart = np.linalg.norm(contacts.points[:, None] - contacts.points, axis=2)
    np.fill_diagonal(apart, np.inf)
    # 50 mm on a face; across the edge, 25 mm from it on either side, 25 sqrt 2.
    assert apart.min() == pytest.approx(0.025 * np.sqrt(2.0))
    assert cube.edges.shape == (12, 2, 3)


def test_noise_moves_contacts_by_its_deviations() -> None:
    clean = Contacts(np.zeros((20_000, 3)), np.tile([0.0, 0.0, 1.0], (20_000, 1)))
    noisy = Noise(0.002, 0.05).disturb(clean, rng=np.random.default_rng(0))
    # The spread of 60 000 numbers is known to 1 / sqrt(120 000) = 0.3 %.
    assert noisy.points.std() == pytest.approx(0.002, rel=0.015)
    tilt = np.arctan2(np.hypot(*noisy.normals[:, :2].T), noisy.normals[:, 2])
    # Two components of 0.05 rad each; the tangent is 0.3 % longer than the angle.
    assert np.sqrt(np.mean(tilt**2) / 2) == pytest.approx(0.05, rel=0.015)
    assert Noise().disturb(clean, rng=np.random.default_rng(0)) is clean


def test_an_estimator_that_is_exact_on_planes_is_exact_at_the_wedge() -> None:
    rows = {r["estimator"]: r for r in run_trial(WEDGE[0], ["lis", "gpis", "patch"])}
    # Two planes and contacts that lie alike on both: the edge is where they meet, for either LIS.
    # The mesh is 2 mm fine, and cut off where bounds close it.
    assert rows["patch"]["edge_rmsd"] < 1e-4
    assert rows["lis"]["edge_rmsd"] < 1e-4
    assert rows["gpis"]["edge_rmsd"] > 20 * rows["lis"]["edge_rmsd"]
    assert {row["contacts"] for row in rows.values()} == {12}


def test_experiments_of_one_object_and_seed_share_the_walk() -> None:
    few, half, whole = (
        run_trial(Trial(experiment, "box", 1), ["patch"])[0]  # type: ignore[arg-type]
        for experiment in ("few", "half", "whole")
    )
    assert 5 <= few["contacts"] <= 8
    assert few["contacts"] < half["contacts"] < whole["contacts"]
    assert few["coverage"] < half["coverage"] < whole["coverage"]


def test_every_trial_is_listed_once_and_seed_by_seed() -> None:
    listed = trials(["whole", "wedge"], 3)
    assert len(listed) == len(set(listed)) == 3 * (len(shapes.NAMES) + len(NOISE_LEVELS))
    assert [trial.seed for trial in listed] == sorted(trial.seed for trial in listed)


def test_an_estimator_that_fails_leaves_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(contacts: Contacts, noise: Noise) -> PatchImplicitSurface:
        return PatchImplicitSurface.from_contacts(Contacts.empty())

    monkeypatch.setattr(
        "lis_grasp.experiments.paper.paper_trials.contender", lambda name: OURS.get(name, nothing)
    )
    first, second = run_trial(WEDGE[0], ["nothing", "patch"])
    assert "at least one contact" in first["failure"]
    assert "rmsd" not in first
    assert "failure" not in second


@pytest.mark.slow
def test_an_interrupted_run_goes_on_and_ends_with_the_rows_of_an_undisturbed_one(
    tmp_path: Path,
) -> None:
    names = ["lis", "patch"]
    whole = ResultsFile(tmp_path / "whole.jsonl")
    assert list(run_trials(whole, WEDGE, names, jobs=1))[-1] == (3, 3)

    broken = ResultsFile(tmp_path / "broken.jsonl")
    for done, _ in run_trials(broken, WEDGE, names[:1], jobs=1):
        if done == 2:
            break
    with broken.path.open("a") as file:
        file.write('{"experiment": "wed')  # killed while writing
    assert len(broken.read()) >= 2
    assert list(run_trials(broken, WEDGE, names, jobs=2))[-1] == (3, 3)
    assert as_lines(broken.path) == as_lines(whole.path)
    # Nothing left to do.
    assert list(run_trials(broken, WEDGE, names, jobs=2)) == [(3, 3)]


@pytest.mark.slow
def test_a_killed_process_is_reported_and_nothing_finished_is_lost(
    tmp_path: Path,
) -> None:
    file = ResultsFile(tmp_path / "results.jsonl")
    with pytest.raises(EstimationError, match="run the command again to go on"):
        for done, _ in run_trials(file, WEDGE, ["lis"], jobs=1):
            if done == 1:
                for child in multiprocessing.active_children():
                    os.kill(child.pid, signal.SIGKILL)
    assert len(file.read()) >= 1
    assert list(run_trials(file, WEDGE, ["lis"], jobs=1))[-1] == (3, 3)


def test_rows_come_back_as_they_were_written(tmp_path: Path) -> None:
    file = ResultsFile(tmp_path / "rows.jsonl")
    assert file.read() == []
    rows = [{"a": 0.1 + 0.2, "b": None}, {"a": 1, "b": "x"}]
    file.append(rows[:1])
    file.append(rows[1:])
    assert file.read() == rows


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nonsense\n", "one JSON object a line"),
        ('{"results": "paper", "version": "0.0.0"}\n', "must be of lis_grasp"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text(text)
    with pytest.raises(InvalidFileError, match=message):
        ResultsFile(path).read()


def rows_of(values: dict[str, list[list[float | None]]]) -> list[dict]:
    return [
        {"experiment": "whole", "object": f"o{i}", "seed": j, "estimator": name, "edge_rmsd": v}
        for name, table in values.items()
        for i, seeds in enumerate(table)
        for j, v in enumerate(seeds)
    ]


def test_a_table_averages_seeds_then_objects() -> None:
    rows = rows_of({"lis": [[1.0, 3.0], [4.0, 6.0]], "gpis": [[4.0, 4.0], [10.0, 10.0]]})
    table = tabulate(rows, "whole", "edge_rmsd")
    assert table.objects == ("o0", "o1")
    np.testing.assert_array_equal(table.per_object("lis"), [2.0, 5.0])
    assert table.overall("lis") == 3.5
    share, low, high = table.reduction("lis", "gpis")
    assert share == pytest.approx(0.5)
    # All resamples of two seeds: both first (1 + 4), both second (3 + 6), one of each.
    assert low == pytest.approx(1.0 - 4.5 / 7.0)
    assert high == pytest.approx(1.0 - 2.5 / 7.0)


def test_what_one_of_two_lacks_is_compared_for_neither() -> None:
    rows = rows_of({"lis": [[1.0, None], [None, None]], "gpis": [[2.0, 8.0], [None, None]]})
    table = tabulate(rows, "whole", "edge_rmsd")
    assert table.overall("gpis") == 5.0
    assert table.reduction("lis", "gpis")[0] == 0.5
    assert np.isnan(table.per_object("lis")[1])


def test_results_are_plain_json() -> None:
    row = run_trial(WEDGE[0], ["patch"])[0]
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert dataclasses.asdict(WEDGE[0]).items() <= row.items()
