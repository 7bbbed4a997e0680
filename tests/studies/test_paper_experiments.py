"""The paper's experiments: trials, results that survive interruption, tables of means."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import PatchImplicitSurface
from lis_grasp_studies.contact_study.draws import random_contacts
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import OURS, Noise, compared_estimator
from lis_grasp_studies.harness.rows import Job, TrialResults
from lis_grasp_studies.harness.statistics import measure_table
from lis_grasp_studies.paper.trials import (
    NOISE_LEVELS,
    PAPER,
    PaperTrial,
    paper_trials,
    touch_wedge,
    wedge,
)

MEANS = {"lis": 1.0, "gpis": 2.0}
WEDGE = [PaperTrial("wedge", "0", 0), PaperTrial("wedge", "2", 0), PaperTrial("wedge", "2", 1)]


def run_trial(trial: PaperTrial, estimators: list[str]) -> list[Row]:
    return PAPER.run(Job(trial, tuple(estimators)))


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
    # Contacts are arranged alike on both planes: either LIS has its edge where the planes meet.
    # The mesh is 2 mm fine, and cut off where bounds close it.
    assert rows["patch"]["edge_rmsd"] < 1e-4
    assert rows["lis"]["edge_rmsd"] < 1e-4
    assert rows["gpis"]["edge_rmsd"] > 20 * rows["lis"]["edge_rmsd"]
    assert {row["contacts"] for row in rows.values()} == {12}


def test_experiments_of_one_object_and_seed_share_the_walk() -> None:
    few, half, whole, random = (
        run_trial(PaperTrial(experiment, "box", 1), ["patch"])[0]  # type: ignore[arg-type]
        for experiment in ("few", "half", "whole", "random")
    )
    assert 5 <= few["contacts"] <= 8
    assert few["contacts"] < half["contacts"] < whole["contacts"]
    assert few["coverage"] < half["coverage"] < whole["coverage"]
    assert random["contacts"] == whole["contacts"]
    assert random["rmsd"] != whole["rmsd"]


def test_every_trial_is_listed_once_and_seed_by_seed() -> None:
    listed = paper_trials(["whole", "wedge"], range(3))
    assert len(listed) == len(set(listed)) == 3 * (len(shapes.NAMES) + len(NOISE_LEVELS))
    assert [trial.seed for trial in listed] == sorted(trial.seed for trial in listed)


def test_an_estimator_that_fails_leaves_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(contacts: Contacts, noise: Noise) -> PatchImplicitSurface:
        return PatchImplicitSurface.from_contacts(Contacts.empty())

    monkeypatch.setattr(
        "lis_grasp_studies.paper.trials.compared_estimator",
        lambda name: compared_estimator(name) if name in OURS else nothing,
    )
    first, second = run_trial(WEDGE[0], ["hermite_rbf", "patch"])
    assert "at least one contact" in first["failure"]
    assert "rmsd" not in first
    assert "failure" not in second


def test_rows_come_back_as_they_were_written(tmp_path: Path) -> None:
    results = TrialResults(tmp_path / "rows.jsonl", "paper")
    assert results.read() == []
    rows = [{"a": 0.1 + 0.2, "b": None}, {"a": 1, "b": "x" * 100_000}]
    results.append(rows[:1])
    results.append(rows[1:])
    with results.path.open("a") as file:
        file.write("y" * 100_000)  # killed while writing a long row
    results.append(rows[:1])
    assert results.read() == [*rows, rows[0]]


@pytest.mark.parametrize(
    "text",
    [
        "nonsense\n",
        '{"results": "paper", "version": "0.0.0"}\n',
        '{"results": "study", "version": "0.0.0"}\n',
    ],
)
def test_another_file_is_an_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "results.jsonl"
    path.write_text(text)
    with pytest.raises(InvalidFileError) as error:
        TrialResults(path, "paper").read()
    assert error.value.path == path
    if "study" in text:
        assert TrialResults(path, "study").read(any_version=True) == []


def test_random_contacts_are_uniform_in_area_and_exact() -> None:
    shape = shapes.build("box", size=0.2)
    surface = SurfacePoints.with_face_normals(shape)
    contacts = random_contacts(surface, 3000, rng=np.random.default_rng(0))
    distances, _ = distances_to_mesh(contacts.points, shape.mesh)
    np.testing.assert_allclose(distances, 0.0, atol=1e-12)
    # Fraction on each side against its area: three standard deviations of 3000 draws at most.
    extents = shape.mesh.extents
    for axis in range(3):
        area = np.prod(np.delete(extents, axis)) / shape.mesh.area
        found = np.mean(contacts.normals[:, axis] > 0.5)
        assert found == pytest.approx(area, abs=3.0 * np.sqrt(area / 3000))


def rows_of(values: dict[str, list[list[float | None]]]) -> list[dict]:
    return [
        {"object": f"o{i}", "seed": j, "estimator": name, "edge_rmsd": v}
        for name, table in values.items()
        for i, seeds in enumerate(table)
        for j, v in enumerate(seeds)
    ]


def test_a_table_averages_seeds_then_objects() -> None:
    rows = rows_of({"lis": [[1.0, 3.0], [4.0, 6.0]], "gpis": [[4.0, 4.0], [10.0, 10.0]]})
    table = measure_table(rows, "edge_rmsd")
    assert table.objects == ("o0", "o1")
    np.testing.assert_array_equal(table.per_object("lis"), [2.0, 5.0])
    assert table.overall("lis") == 3.5
    reduction, interval = table.reduction("lis", "gpis")
    assert reduction == pytest.approx(0.5)
    assert interval == (None, None)  # of two seeds


@pytest.mark.parametrize("seeds", [4, 10])
def test_reductions_have_their_coverage(seeds: int) -> None:
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(200):
        values = {name: c * rng.lognormal(0.0, 0.3, (6, seeds)) for name, c in MEANS.items()}
        table = measure_table(rows_of({n: v.tolist() for n, v in values.items()}), "edge_rmsd")
        _, (low, high) = table.reduction("lis", "gpis")
        assert low is not None
        assert high is not None
        covered.append(low <= 1.0 - MEANS["lis"] / MEANS["gpis"] <= high)
    # Three standard deviations of a rate of 95 % in 200 are 4.6 points.
    assert np.mean(covered) == pytest.approx(0.95, abs=0.05)


def test_what_one_of_two_lacks_is_compared_for_neither() -> None:
    rows = rows_of({"lis": [[1.0, None], [None, None]], "gpis": [[2.0, 8.0], [None, None]]})
    table = measure_table(rows, "edge_rmsd")
    assert table.overall("gpis") == 5.0
    assert table.reduction("lis", "gpis")[0] == 0.5
    assert np.isnan(table.per_object("lis")[1])


def test_results_are_plain_json() -> None:
    row = run_trial(WEDGE[0], ["patch"])[0]
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    assert dataclasses.asdict(WEDGE[0]).items() <= row.items()
