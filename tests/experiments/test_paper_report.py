"""The report of the paper's experiments: what it says of results, and that it is one whole page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lis_grasp import shapes
from lis_grasp.cli.main import main
from lis_grasp.experiments.paper.claims import exact_claims, our_claims, paper_claims
from lis_grasp.experiments.paper.exactness import cube_edge_error
from lis_grasp.experiments.paper.paper_page import Picture, write_report
from lis_grasp.experiments.paper.paper_tables import measures_table, objects_table, rows_as_csv

EDGE_MM = {"gpis": 6.0, "lis": 2.4, "blend": 0.6}
FACE_MM = {"gpis": 2.0, "lis": 2.2, "blend": 1.0}


def rows_of(seeds: int = 3) -> list[dict]:
    """Results in which estimators differ by round factors, whatever the object and seed."""
    rows = []
    for experiment in ("whole", "half", "few", "noisy", "wedge"):
        objects = [str(k) for k in range(6)] if experiment == "wedge" else shapes.NAMES
        for name in objects:
            for seed in range(seeds):
                for estimator in EDGE_MM:
                    factor = 1.0 + 0.1 * seed
                    rows.append(
                        {
                            "experiment": experiment,
                            "object": name,
                            "seed": seed,
                            "estimator": estimator,
                            "rmsd": 1e-3 * factor * FACE_MM[estimator],
                            "rmsd_truth_to_estimate": 1e-3 * factor * FACE_MM[estimator],
                            "edge_rmsd": None
                            if name in ("sphere", "torus")
                            else 1e-3 * factor * EDGE_MM[estimator],
                        }
                    )
    return rows


def verdicts(claims: list) -> dict[str, tuple[str, str]]:
    return {claim.statement: (claim.measured, claim.verdict) for claim in claims}


def test_the_paper_s_claims_are_judged_by_the_numbers() -> None:
    found = verdicts(paper_claims(rows_of()))
    measured, verdict = found["LIS is below GPIS at edges (fig. 10)"]
    assert measured.startswith("−60 %")
    assert verdict == "reproduces"
    measured, verdict = found["LIS and GPIS are alike overall (fig. 9), estimate to truth"]
    assert "+10 %" in measured
    assert verdict == "reproduces"
    measured, verdict = found["LIS is below GPIS on the box (fig. 9), truth to estimate"]
    assert measured.startswith("+10 %")
    assert verdict == "does not"


def test_our_claims_are_met_or_missed_by_the_numbers() -> None:
    found = verdicts(our_claims(rows_of(), "blend"))
    assert found["fully explored, edges"] == ("−90 % (−90 % to −90 %)", "met")
    assert found["fully explored, truth to estimate"] == ("−50 % (−50 % to −50 %)", "met")
    assert found["the worst single object, fully explored, truth to estimate"][1] == "met"
    # An estimator that is worse than GPIS misses what is claimed.
    assert (
        verdicts(our_claims(rows_of(), "lis"))["fully explored, truth to estimate"][1] == "missed"
    )


def test_what_should_be_exact_is() -> None:
    assert [claim.verdict for claim in exact_claims("blend")] == ["met", "met"]
    # GPIS makes a ball of the cube: its edges are sqrt(2) - 1 of half a side away and more.
    assert exact_claims("gpis")[0].verdict == "missed"
    assert cube_edge_error("gpis") > 0.4 * 0.05


def test_tables_hold_means_over_objects_and_seeds() -> None:
    # Seeds have factors 1, 1.1, 1.2.
    table = measures_table(rows_of(), "whole")
    row = re.search(r"<tr><th>GPIS</th>(.*?)</tr>", table)
    assert row is not None
    assert re.findall(r"<td>(.*?)</td>", row[1])[:3] == ["2.20", "2.20", "6.60"]
    per_object = objects_table(rows_of(), "whole", "edge_rmsd")
    sphere = re.search(r"<tr><th>sphere</th>(.*?)</tr>", per_object)
    assert sphere is not None
    assert "±" not in sphere[1]
    assert "6.60 ± 0.49" in per_object  # 6 mm times the deviation of 1, 1.1, 1.2


def test_equal_results_make_equal_files_whatever_their_order() -> None:
    rows = rows_of()
    assert rows_as_csv(rows) == rows_as_csv(rows[::-1])
    assert len(rows_as_csv(rows).splitlines()) == len(rows) + 1


def test_the_page_is_whole_and_loads_nothing(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    failed = {
        "experiment": "few",
        "object": "box",
        "seed": 0,
        "estimator": "lis",
        "failure": "<b>no</b> surface",
    }
    picture = Picture("Figure <1>", "A & B", b"\x89PNG")
    write_report(
        path, [*rows_of(), failed], [picture], command="lis-grasp paper", estimator="blend"
    )
    page = path.read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert "Figure &lt;1&gt;" in page
    assert "&lt;b&gt;no&lt;/b&gt; surface" in page
    assert "A &amp; B" in page
    assert not re.findall(r"(?:src|href)=[\"'](?!data:)", page)
    assert "nan" not in page.lower().replace("nano", "")


@pytest.mark.slow
def test_a_quick_report_has_every_figure_and_says_how_to_make_it_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", "--quick", "--seeds", "1", "--output", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for number in (1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12):
        assert f"<b>Figure {number}" in page
    assert page.count("<img ") == 13
    assert "lis-grasp paper --quick --seeds 1" in page
    assert (tmp_path / "trials.csv").read_text().count("\n") > 100
    assert "report.html" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "0"], "--seeds must be at least 1"),
        (["--jobs", "-1"], "--jobs must be at least 1"),
        (["--estimators", "lis"], "compares with 'gpis'"),
    ],
)
def test_what_cannot_be_reported_is_refused(
    tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", *arguments, "--output", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
