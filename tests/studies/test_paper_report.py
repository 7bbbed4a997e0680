"""The report of the paper's experiments: claims, tables, and one self-contained page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lis_grasp import shapes
from lis_grasp.cli.main import main
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.tables import Table
from lis_grasp_studies.paper.report import write_report
from lis_grasp_studies.paper.tables import (
    changes_table,
    claims_table,
    cube_edge_error,
    measures_table,
    meshing_loss,
    objects_table,
    rows_as_csv,
)

EDGE_MM = {"gpis": 6.0, "lis": 2.4, "blend": 0.6}
FACE_MM = {"gpis": 2.0, "lis": 2.2, "blend": 1.0}


def rows_of(seeds: int = 3) -> list[dict]:
    """Results in which estimators differ by round factors, whatever the object and seed."""
    rows = []
    for experiment in ("whole", "half", "few", "noisy", "random", "wedge"):
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


def test_verdicts_on_the_paper_s_claims_follow_the_numbers() -> None:
    found = {line[0]: line[2:] for line in claims_table(rows_of()).body}
    measured, verdict = found["LIS is below GPIS at edges (fig. 10)"]
    assert measured.startswith("LIS −60 %")
    assert verdict == "reproduced"
    measured, verdict = found["LIS and GPIS are alike overall (fig. 9), estimate to truth"]
    assert "+10 %" in measured
    assert verdict == "reproduced"
    measured, verdict = found["LIS is below GPIS on the box (fig. 9), truth to estimate"]
    assert measured.startswith("LIS +10 %")
    assert verdict == "not reproduced"


def test_the_change_from_gpis_follows_the_numbers() -> None:
    titles = {"whole": "fully explored", "random": "random contacts", "wedge": "round an edge"}
    (line, *_) = changes_table(rows_of(3), "blend", titles).body
    assert line[1] == "−50 %"  # of three seeds there is no interval
    table = {row[0]: row[1:] for row in changes_table(rows_of(4), "blend", titles).body}
    for title in ("fully explored", "random contacts"):
        assert table[title][0] == table[title][1] == "−50 % (−50 % to −50 %)"
        assert table[title][2] == "−90 % (−90 % to −90 %)"
    assert table["… worst object"][0].startswith("0.50 times (")
    assert sum(name.startswith("at an edge") for name in table) == 6
    (other,) = (r for r in changes_table(rows_of(), "lis", {"whole": "a"}).body if r[0] == "a")
    assert other[1].startswith("+10 %")


def test_a_cube_from_six_contacts_and_meshes_of_exact_estimates_have_sharp_edges() -> None:
    assert cube_edge_error("lis") < 1e-4
    assert meshing_loss(0.008, seeds=1) < 1e-4
    # GPIS and blend make a ball of the cube: edges are sqrt(2) - 1 of half a side away and more.
    assert cube_edge_error("gpis") > 0.4 * 0.05
    assert cube_edge_error("blend") > 0.4 * 0.05


def test_tables_hold_means_over_objects_and_seeds() -> None:
    # Seeds have factors 1, 1.1, 1.2.
    table = {row[0]: row[1:] for row in measures_table(rows_of(), "whole", "").body}
    assert table["GPIS"][:3] == ("2.20", "2.20", "6.60")
    objects = objects_table(rows_of(), "whole", "edge_rmsd", "")
    per_object = {row[0]: row[1:] for row in objects.body}
    assert set(per_object["sphere"]) == {"–"}
    assert per_object["box"][0] == "6.60 ± 0.49"  # 6 mm times the deviation of 1, 1.1, 1.2


def test_equal_results_make_equal_files_whatever_their_order() -> None:
    rows = rows_of()
    assert rows_as_csv(rows) == rows_as_csv(rows[::-1])
    assert len(rows_as_csv(rows).splitlines()) == len(rows) + 1


def test_the_page_is_whole_and_loads_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = Table("exact", "exact", ("",), (("0",),))
    monkeypatch.setattr("lis_grasp_studies.paper.tables.exactness_table", lambda: exact)
    path = tmp_path / "report.html"
    failed = {
        "experiment": "few",
        "object": "box",
        "seed": 0,
        "estimator": "lis",
        "failure": "<b>no</b> surface",
    }
    picture = Picture("Figure <1>", "A & B", b"\x89PNG", b"%PDF")
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
        (["--seeds", "0"], "seeds must be at least 1"),
        (["--jobs", "-1"], "--jobs must be at least 1"),
        (["--estimators", "lis"], "compares with 'gpis'"),
    ],
)
def test_what_cannot_be_reported_is_refused(
    tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", *arguments, "--output", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
