"""The report of a study: what it says of results, and that it is one whole page."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable
from dataclasses import asdict, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from lis_grasp.io.json_lines import Row
from lis_grasp.version import __version__
from lis_grasp_studies.evaluation.simulators import (
    SIMULATIONS,
    difference_table,
    disagreements_table,
    held_table,
)
from lis_grasp_studies.harness.calibration import chance_calibration_error
from lis_grasp_studies.harness.page import Picture
from lis_grasp_studies.harness.rows import Job, TrialResults
from lis_grasp_studies.harness.tables import Table, rows_csv, write_tables
from lis_grasp_studies.study import tables as study_tables
from lis_grasp_studies.study.cases import draw_cases, write_report
from lis_grasp_studies.study.cells import printed
from lis_grasp_studies.study.columns import COLUMNS
from lis_grasp_studies.study.comparison import clearest_pairs, compare
from lis_grasp_studies.study.figures import (
    both_widths,
    draw_pictures,
    epsilon_against_truth,
    held_against_edge_error,
    held_against_touches,
)
from lis_grasp_studies.study.run import run_trial
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.tables import (
    all_tables,
    calibration_table,
    differences_table,
    losses_table,
    nearer_table,
    objects_table,
    summary_table,
)
from lis_grasp_studies.study.trial import row_key

pytest.importorskip("statsmodels", reason="needs lis-grasp[study]")

STUDY = Study(
    objects=("box", "sphere"),
    estimators=("gpis", "blend"),
    touches=(10, 20),
    noise=("none",),
    seeds=tuple(range(6)),
)


def rows_of(study: Study = STUDY) -> list[Row]:
    """Results in which blend always holds but once, and gpis never but then."""
    rows: list[Row] = []
    for trial in study.trials():
        odd = (trial.object, trial.touches, trial.seed) == ("box", 10, 3)
        for name in study.estimators:
            held = (name == "blend") != odd
            rows.append(
                {
                    "key": row_key(trial, name),
                    **{
                        n: getattr(trial, n) for n in ("object", "hand", "touches", "noise", "seed")
                    },
                    "estimator": name,
                    "edged": trial.object == "box",
                    "held": held,
                    "version": __version__,
                    "reason": "held" if held else "no_grasp",
                    "failure": None if held else "<b>no</b> surface",
                    "success_probability": 0.9 if held else None,
                    "epsilon_estimate": 0.2 if held else None,
                    "epsilon_truth": 0.15 if held else None,
                    "epsilon_gap": 0.05 if held else None,
                    "rmsd": 1e-3 if name == "blend" else 2e-3,
                    "rmsd_truth_to_estimate": 1e-3,
                    "edge_rmsd": 3e-3 if trial.object == "box" else None,
                }
            )
    return rows


def report(folder: Path, rows: list[Row], *, pictures: Iterable[Picture] = ()) -> str:
    tables = all_tables(rows, compare(rows, "gpis"), "gpis")
    path = folder / "report.html"
    write_report(path, STUDY, rows, tables, pictures, command="lis-grasp compare")
    write_tables(folder, tables, latex=True)
    (folder / "rows.csv").write_text(rows_csv(rows, COLUMNS))
    return (folder / "report.html").read_text(encoding="utf-8")


def test_the_page_is_whole_and_loads_nothing(tmp_path: Path) -> None:
    page = report(tmp_path, rows_of(), pictures=draw_pictures(rows_of()))
    assert page.startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert page.count("<img ") == 3
    assert "&lt;b&gt;no&lt;/b&gt; surface" in page
    assert not re.findall(r"(?:src|href)=[\"'](?!data:)", page)
    text = re.sub(r"base64,[^\"]*", "", page)
    assert not re.search(r"\bnan\b", text)
    assert "Only" not in text


def test_success_rates_have_intervals_at_each_budget() -> None:
    table = study_tables.held_table(rows_of(), "all")
    assert table.head == ("estimator", "noise", "10 touches", "20 touches", "all")
    assert [row[:2] for row in table.body] == [("GPIS", "none"), ("blend", "none")]
    # All of 12: Wilson's interval of 12 of 12.
    assert table.body[1][3] == "100 (76 to 100)"
    assert re.fullmatch(r"96 \(\d+ to 100\)", table.body[1][4])
    differences = differences_table(rows_of(), "gpis")
    assert [row[0] for row in differences.body] == ["blend"]
    assert differences.body[0][2].startswith("+83.3 (")
    assert study_tables.held_table(rows_of(), "curved").body[1][2] == "100"  # too few clusters


def test_the_summary_joins_levels_of_noise_and_separates_hands() -> None:
    quiet = rows_of()
    loud = [row | {"noise": "1mm", "hand": "wsg50", "held": False} for row in quiet]
    table = summary_table(quiet + loud, "gpis")
    assert table.head[1:7] == (
        "10 touches",
        "20 touches",
        "all",
        "allegro",
        "wsg50",
        "minus GPIS",
    )
    gpis, blend = table.body
    assert gpis[-2:] == ("–", "–")
    # 23 of 24, and 0 of 24 with noise; every cluster of an object and seed has both.
    assert blend[3].startswith("48 (")
    assert blend[4].startswith("96 (")
    assert blend[5] == "0 (0 to 24)"
    assert blend[6].startswith("+45.8 (")


def test_pairs_are_counted_in_which_the_smaller_error_held() -> None:
    worse = [
        row | {"estimator": "lis", "held": False, "rmsd": 1e-3}
        for row in rows_of()
        if row["estimator"] == "blend"
    ]
    table = nearer_table(rows_of() + worse, "gpis")
    assert table.head[:3] == ("GPIS and", "estimate to truth", "truth to estimate")
    cells = {row[0]: row[1] for row in table.body}
    # blend is nearer and held but once; lis is nearer, and gpis held once where it did not.
    assert cells["blend"] == "96 % of 24, p < 0.001"
    assert cells["LIS"] == "0 % of 1, p = 1.000"
    assert cells["all"] == "92 % of 25, p < 0.001"


def test_tables_become_markdown() -> None:
    table = Table("t", "t", ("a", "b"), (("1", "2"),))
    assert table.markdown() == "| a | b |\n| --- | --- |\n| 1 | 2 |\n"


def test_a_study_that_is_not_done_says_so(tmp_path: Path) -> None:
    assert "Only 30 of 48 rows are done" in report(tmp_path, rows_of()[:30])


def test_every_loss_is_listed_with_its_key() -> None:
    (loss,) = losses_table(rows_of(), "gpis").body
    assert loss[:7] == ("blend", "box", "allegro", "10", "none", "3", "<b>no</b> surface")
    assert loss[-1] == row_key(
        next(t for t in STUDY.trials() if (t.object, t.touches, t.seed) == ("box", 10, 3)),
        "blend",
    )


def test_tables_are_exported_as_csv_and_latex(tmp_path: Path) -> None:
    report(tmp_path, rows_of())
    with (tmp_path / "reasons.csv").open() as file:
        assert list(csv.reader(file)) == [
            ["reason", "GPIS", "blend"],
            ["held", "1", "23"],
            ["no_grasp", "23", "1"],
        ]
    latex = (tmp_path / "reasons.tex").read_text()
    assert r"no\_grasp & 23 & 1 \\" in latex
    assert r"\begin{tabular}{lrr}" in latex
    with (tmp_path / "rows.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(rows_of())


def test_text_that_latex_reads_as_commands_is_escaped() -> None:
    table = Table("t", "t", ("a_b [%]",), (("1 & 2",), ("−1",), ("#3",)))
    assert r"a\_b [\%] \\" in table.latex()
    assert "1 \\& 2 \\\\\n$-$1 \\\\\n\\#3 \\\\\n" in table.latex()


@pytest.mark.parametrize(
    ("measure", "value", "text"),
    [
        ("held", 0.5, "50.0"),
        ("epsilon_truth", 0.1234, "0.123"),
        ("rmsd", 0.00234, "2.34"),
        ("rmsd", None, "–"),
        ("rmsd", float("nan"), "–"),
    ],
)
def test_values_are_printed_in_their_units(measure: str, value: float, text: str) -> None:
    assert printed(measure, value) == text


def test_calibration_compares_predicted_and_observed_rates() -> None:
    rows = [row | {"held": False} if row["seed"] == 0 else row for row in rows_of()]
    tried = [r for r in rows if r["estimator"] == "blend" and r["success_probability"] is not None]
    (line,) = [line for line in calibration_table(rows).body if line[0] == "blend"]
    observed = np.mean([row["held"] for row in tried])
    error = abs(observed - 0.9)
    # All are predicted 0.9, above what is observed: one bin, on every object too.
    of = {name: [r["held"] for r in tried if r["object"] == name] for name in ("box", "sphere")}
    by_object = np.mean([abs(np.mean(held) - 0.9) for held in of.values()])
    chance = chance_calibration_error([0.9] * len(tried))
    expected = (0.9, observed, error, chance, by_object)
    assert line[2:] == (str(len(tried)), *(f"{100 * value:.1f}" for value in expected))


def test_grasps_planned_on_the_truth_count_once_for_all_touches_of_a_fixed_object() -> None:
    rows = [row | {"estimator": "truth"} for row in rows_of() if row["estimator"] == "blend"]
    (line,) = calibration_table(rows).body
    assert line[2] == str(len({(row["object"], row["seed"]) for row in rows}))
    # Touches move a free object, so each of its trials has a grasp of its own.
    (line,) = calibration_table([row | {"conditions": "unknown"} for row in rows]).body
    assert line[2] == str(sum(row["success_probability"] is not None for row in rows))


def test_errors_and_success_are_listed_by_object_noise_and_touches() -> None:
    table = objects_table(rows_of(), "rmsd")
    assert table.head == ("object", "noise", "touches", "GPIS", "blend")
    assert table.body[0] == ("box", "none", "10", "2.00", "1.00")
    assert len(table.body) == 2 * 2
    held = {row[:3]: row[3:] for row in objects_table(rows_of(), "held").body}
    # Of six seeds on the box at 10 touches, blend fails once, and gpis holds that one.
    assert held["box", "none", "10"] == (f"{100 / 6:.1f}", f"{500 / 6:.1f}")


def test_the_clearest_pairs_are_those_with_the_greatest_difference_on_the_truth() -> None:
    rows = rows_of()
    for row in rows:
        if (row["object"], row["touches"], row["seed"]) == ("sphere", 20, 4) and row["held"]:
            row["epsilon_truth"] = 0.4
    (winner, loser), (other, lost) = clearest_pairs(rows, "gpis")
    assert (winner["estimator"], winner["object"], winner["seed"]) == ("blend", "sphere", 4)
    assert loser["estimator"] == "gpis"
    assert (other["estimator"], lost["estimator"]) == ("gpis", "blend")
    assert (lost["object"], lost["touches"], lost["seed"]) == ("box", 10, 3)
    assert clearest_pairs([row for row in rows if row["estimator"] == "gpis"], "gpis") == []


@pytest.mark.slow
def test_clearest_pairs_become_a_picture_and_a_scene_each(tmp_path: Path) -> None:
    trial = replace(STUDY, objects=("sphere",), touches=(6,), seeds=(0,), grasps=1).trials()[0]
    rows = [
        row | asdict(trial.setup) | {"held": held}
        for row, held in zip(run_trial(Job(trial, ("gpis", "blend"))), (0, 1), strict=True)
    ]
    (picture,) = draw_cases(tmp_path, rows, "gpis", ())
    assert picture.title == "The clearest win of blend"
    scenes = sorted(path.stem for path in (tmp_path / "cases").iterdir())
    assert scenes == sorted(row["key"] for row in rows)
    assert all(f"cases/{key}.html" in picture.caption for key in scenes)
    # Rows of another version, or whose mesh is not there, are not made again.
    old = [row | {"version": "0"} for row in rows]
    gone = [row | {"object": "can.ply", "object_digest": "ab"} for row in rows]
    assert list(draw_cases(tmp_path, old, "gpis", ())) == []
    assert list(draw_cases(tmp_path, gone, "gpis", ())) == []


def test_figures_of_both_widths_hold_their_type() -> None:
    names = ("gpis", "lis", "blend", "truth")
    rows = [row | {"estimator": name} for name in names for row in rows_of()]
    for draw in (held_against_touches, epsilon_against_truth, held_against_edge_error):
        for figure in both_widths(draw, rows):
            renderer = FigureCanvasAgg(figure).get_renderer()
            whole, size = figure.get_tightbbox(renderer), figure.get_size_inches()
            assert (whole.min >= 0.0).all()
            assert (whole.max <= size).all()
            boxes = [axes.get_tightbbox(renderer) for axes in figure.axes]
            boxes += [legend.get_tightbbox(renderer) for legend in figure.legends]
            assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
            assert min(text.get_fontsize() for text in figure.findobj(Text)) >= 8.0


def test_rates_are_drawn_close_to_their_number_of_touches() -> None:
    names = ("gpis", "lis", "blend", "patch", "truth")
    rows = [row | {"estimator": name} for name in names for row in rows_of()]
    (first, *_) = held_against_touches(rows).axes
    assert [tick.get_text() for tick in first.get_xticklabels()] == ["10", "20"]
    places = np.array([line.get_xdata() for line in first.lines])  # (estimators, numbers)
    assert len(np.unique(places)) == places.size
    # Closer to their own tick than a quarter of the way to the next.
    assert np.abs(places - first.get_xticks()).max() < 0.25


def lifts_in_both() -> list[Row]:
    """Return rows of three trials of both simulators; GPIS held none."""
    facts = {"hand": "wsg50", "touches": 40, "noise": "none", "seed": 4}
    held = {"cup": (True, True), "pen": (True, False), "key": (False, False)}
    failures = {"cup": "dropped", "pen": "dropped", "key": "no_grasp"}
    return [
        facts
        | {"object": name, "estimator": estimator, "simulator": simulator}
        | {"held": (holds := estimator == "blend" and outcome), "slip": 0.003, "turn": 0.3}
        | {"reason": "held" if holds else failures[name]}
        for name, outcomes in held.items()
        for estimator in ("gpis", "blend")
        for simulator, outcome in zip(("drake", "mujoco"), outcomes, strict=True)
    ]


def test_lifts_in_both_simulators_are_compared_where_a_grasp_was_executed() -> None:
    rows = lifts_in_both()
    held = {line[0]: line[1:] for line in held_table(rows).body}
    # Of two trials MuJoCo dropped one; the third had no grasp, and is no agreement.
    assert held["blend"] == ("3", "67", "33", "1 of 2 (50 %)")
    differences = {line[0]: line[1:] for line in difference_table(rows, "blend", "gpis").body}
    assert differences["MuJoCo"] == ("+33.3", "+33.3")
    (line,) = disagreements_table(rows).body
    assert line == ("pen", "`wsg50`", "blend", "held, 3 mm, 17°", "dropped, 3 mm, 17°")


def test_stored_rows_of_both_simulators_load(tmp_path: Path) -> None:
    trial = {"object": "box", "hand": "wsg50", "touches": 40, "noise": "0.5mm/3deg", "seed": 4}
    lift = {"lifted": True, "reason": "held", "slip": 3e-4, "turn": 0.03}
    rows = [
        trial | lift | {"estimator": name, "simulator": simulator, "held": True}
        for name in ("gpis", "blend", "truth")
        for simulator in ("drake", "mujoco")
    ]
    header = {"results": "simulators", "version": "1.1.0"}
    lines = "".join(json.dumps(line) + "\n" for line in (header, *rows))  # as 1.4 published them
    (tmp_path / "simulators.jsonl").write_text(lines)
    both = TrialResults(tmp_path / "simulators.jsonl", SIMULATIONS.kind).read(any_version=True)
    assert SIMULATIONS.variant in both[0]
    assert len(held_table(both).body) == 3
