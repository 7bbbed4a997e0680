"""The study of contact sets: ratios, tables, and the command from end to end."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lis_grasp.cli.main import main
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp_studies.contact_study.contact_sets import ContactCase, contact_set
from lis_grasp_studies.contact_study.score import score_truth
from lis_grasp_studies.contact_study.tables import (
    FLOOR,
    by_family_table,
    by_object_table,
    calibration_table,
    error_ratios,
    losses_table,
    summarise,
)
from lis_grasp_studies.estimators import COMPETITORS, TUNED, compared_estimator

_KINDS = {".pdf": b"%PDF", ".png": b"\x89PNG"}  # how files of figures begin


def row(name: str, estimator: str, errors: tuple[float, float], **facts: Any) -> dict[str, Any]:
    return {
        "object": name,
        "family": "thin",
        "case": "even-20",
        "kind": "even",
        "seed": 0,
        "box": "contacts",
        "size": 0.2,
        "estimator": estimator,
        "failure": "",
        "truth_to_estimate": errors[0],
        "estimate_to_truth": errors[1],
        "edge": None,
        "within_68": 0.68,
        "within_95": 0.5,
        "truth_within_68": 0.68,
        "truth_within_95": 0.95,
        "fit_seconds": 0.01,
    } | facts


def rows_of_two(count: int = 8) -> list[dict[str, Any]]:
    """Return rows in which `b` has half the errors of `a`, but twice those on the last object."""
    floor = FLOOR * 0.2
    found = []
    for k in range(count):
        factor = 0.5 if k < count - 1 else 2.0
        found.append(row(f"o{k}", "a", (0.01 - floor, 0.02 - floor)))
        found.append(row(f"o{k}", "b", (0.01 * factor - floor, 0.02 * factor - floor)))
    return found


def test_ratios_are_of_errors_plus_the_floor() -> None:
    ratios = [r for r in error_ratios(rows_of_two(), "a") if r.estimator == "b"]
    assert [r.truth_to_estimate for r in ratios] == pytest.approx([0.5] * 7 + [2.0])
    summary = summarise(ratios, "estimate_to_truth")
    assert summary.mean == pytest.approx(2.0 ** (-6 / 8))
    assert summary.low is not None
    assert summary.high is not None
    assert 0.45 < summary.low < summary.mean < summary.high < 2.0
    assert summarise(ratios[:5], "estimate_to_truth").low is None  # too few objects


def test_rows_without_the_reference_are_left_out() -> None:
    rows = [r for r in rows_of_two() if not (r["object"] == "o0" and r["estimator"] == "a")]
    assert {r.object for r in error_ratios(rows, "a")} == {f"o{k}" for k in range(1, 8)}


def test_the_tables_name_the_worst_set_and_every_loss() -> None:
    ratios = error_ratios(rows_of_two(), "a")
    last = by_family_table(ratios, "b").body[-1]
    assert last[:3] == ("all", "all", "8")
    assert last[-2:] == ("1", "2.00: o7, even-20")
    losses = losses_table(ratios, "b")
    assert [line[0] for line in losses.body] == ["o7"]
    by_object = {line[0]: line[-1] for line in by_object_table(ratios, ["b"]).body}
    assert by_object["o0"] == "0.50 / 0.50"
    assert by_object["o7"] == "**2.00** / **2.00**"


def test_rates_more_than_five_points_off_are_bold() -> None:
    rates = calibration_table(rows_of_two(), ["a"]).body[0]
    assert rates == ("even", "68% / 68%", "**50%** / 95%")


def test_the_clipped_truth_has_no_errors_but_those_of_the_box() -> None:
    data = contact_set("plate", ContactCase("clustered", 30))
    clipped, whole = (score_truth(data, box=box) for box in ("contacts", "explored"))
    # Even samples of two meshes of one surface; distances are exact.
    assert whole.truth_to_estimate < 1e-9
    assert whole.estimate_to_truth < 1e-9
    assert clipped.truth_to_estimate > 0.001  # the box ends within the plate


def test_the_chosen_settings_were_searched() -> None:
    assert all(one.chosen in one.searched for one in COMPETITORS.values())


@pytest.mark.parametrize("name", COMPETITORS)
def test_every_competitor_takes_contacts_with_and_without_noise(name: str) -> None:
    if name in ("poisson", "apss"):
        pytest.importorskip("pymeshlab")
    for given in (False, True):
        data = contact_set("sphere", ContactCase("even", 40, level=1, given=given))
        surface = compared_estimator(name, TUNED)(data.contacts, data.given_noise)
        assert surface.evaluate(np.zeros(3)) < 0.0
        assert (surface.evaluate(np.array([[0.08, 0.0, 0.0], [0.0, 0.0, -0.08]])) > 0.0).all()


def test_the_default_gpis_is_among_the_searched_settings() -> None:
    data = contact_set("vase", ContactCase("even", 20))
    default = GaussianProcessImplicitSurface.from_contacts(data.contacts)
    settings = {"kernel": "matern52", "length": 0.8, "misfit": (0.001, 0.1)}
    assert settings in COMPETITORS["gpis_best"].searched
    same = COMPETITORS["gpis_best"].make(data.contacts, **settings)
    points = data.exact.points[:5] + 0.003
    np.testing.assert_allclose(same.evaluate(points), default.evaluate(points), rtol=1e-12)


def test_the_command_writes_tables_and_continues(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["surfaces", "--shapes", "development", "--families", "organic", "--part", "30"]
    arguments += ["--reference", "gpis", "--jobs", "1", "--output", str(tmp_path)]
    assert main([*arguments, "--estimators", "gpis", "hermite_rbf"]) == 0
    results = tmp_path / "results.jsonl"
    first = results.read_text().splitlines()
    arguments += ["--figures", str(tmp_path / "figures")]
    assert main([*arguments, "--estimators", "thin_plate", "gpis"]) == 0
    lines = results.read_text().splitlines()
    assert lines[: len(first)] == first  # finished rows stay, the others follow
    added = [json.loads(line) for line in lines[len(first) :]]
    assert {r["estimator"] for r in added} == {"thin_plate"}
    figures = {path.name: path.read_bytes()[:4] for path in (tmp_path / "figures").iterdir()}
    name = "errors_of_surfaces_by_family"
    names = (name, f"{name}_one_column")
    assert figures == {f"{n}{end}": begin for n in names for end, begin in _KINDS.items()}
    page = (tmp_path / "surfaces.md").read_text()
    assert "lis-grasp surfaces --shapes development --families organic" in page
    with (tmp_path / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {r["estimator"] for r in rows} == {"thin_plate", "gpis", "truth"}
    assert {r["object"] for r in rows} == {"lumpy", "bean", "dumbbell"}
    names = {"by_kind", "by_family", "by_object", "errors", "calibration", "losses", "rows"}
    assert {path.stem for path in tmp_path.glob("*.csv")} == names
    assert "next: read" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--estimators", "gpis"], "gpis_best"),
        (["--estimators", "gpis_best"], "no other"),
        (["--estimators", "best", "gpis_best"], "best"),
        (["--families", "round"], "round"),
        (["--box", "large"], "--box"),
        (["--part", "0"], "--part"),
        (["--part", "1000"], "--part"),
        (["--seeds", "0"], "seeds"),
        (["--meshes", "{empty}"], "mesh files"),
    ],
)
def test_misuse_exits_with_2_and_names_the_option(
    tmp_path: Path, arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [text.format(empty=tmp_path) for text in arguments]
    assert main(["surfaces", *given, "--output", str(tmp_path / "out")]) == 2
    assert word in capsys.readouterr().err
