"""The numbers of README and of the results page are those of the published rows."""

import re
from collections.abc import Iterator
from functools import cache
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.tables import calibration_table, error_ratios, summarise
from lis_grasp_studies.evaluation.configuration import Configuration
from lis_grasp_studies.evaluation.grasp_tables import beside_table, family_rates, held_rates
from lis_grasp_studies.evaluation.part import Part
from lis_grasp_studies.evaluation.results import EvaluationResults
from lis_grasp_studies.harness.tables import Table, where
from lis_grasp_studies.study.results import read_parquet

pytestmark = pytest.mark.experiments

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "docs" / "study"
PAGE, README = ROOT / "docs" / "results.md", ROOT / "README.md"


@cache
def _published() -> dict[str, tuple[Part, list[Row]]]:
    """Return the parts of the published evaluation that have rows, with these."""
    pytest.importorskip("pyarrow")
    configuration = Configuration.load(STUDY / "configuration.yaml")
    rows = EvaluationResults(STUDY).read(any_version=True)
    parts = {name: of for name, of in configuration.ordered(rows).items() if of}
    assert sum(map(len, parts.values())) == len(rows), "rows of no published trial"
    return {name: (configuration.parts[name], of) for name, of in parts.items()}


def _numbers(part: str, index: int = 0) -> dict[str, float]:
    """Return the numbers of a part's answer."""
    kind, rows = _published()[part]
    return kind.answers(rows)[index].numbers


def _tables() -> Iterator[Table]:
    parts = _published()
    for part, rows in parts.values():
        yield from part.tables(rows)
    part, rows = parts["grasps"]
    yield beside_table(rows, read_parquet(STUDY / "rows-0.11.parquet"), part.objects)
    yield calibration_table(parts["surfaces"][1], ["blend", "gpis"])


def _text(page: Path) -> str:
    return " ".join(page.read_text(encoding="utf-8").replace("**", "").split())


def test_the_rows_of_a_part_are_of_one_commit_that_the_page_names() -> None:
    text = _text(PAGE)
    for name, (_, rows) in _published().items():
        ((version, commit),) = {(row["version"], row["commit"]) for row in rows}
        assert f"version {version}" in text, name
        assert f"commit {commit[:8]}" in text, name


def test_every_table_of_the_results_page_is_made_of_the_rows() -> None:
    lines = iter(PAGE.read_text(encoding="utf-8").splitlines())
    stated = [
        (line, *takewhile(lambda other: other.startswith("|"), lines))
        for line in lines
        if line.startswith("|")
    ]
    made = [table.markdown().splitlines() for table in _tables()]
    for head, _, *body in stated[1:]:  # the first has the answers, which the next test checks
        same = {line for lines in made if lines[0] == head for line in lines[2:]}
        assert body, head
        assert not set(body) - same, head
    assert len(stated) > 12


def test_answers_and_limits_are_those_of_the_rows() -> None:
    text = _text(PAGE)
    edges, ratios = _numbers("paper"), _numbers("surfaces")
    held, several = _numbers("grasps"), _numbers("grasps", 1)
    hard, hard_several = _numbers("hard"), _numbers("hard", 1)
    part, rows = _published()["grasps"]
    once = where(rows, attempts=1)
    tools = family_rates(once, part.objects)["tools", "blend"]
    lifted = [
        row for row in where(once, estimator="blend") if row["success_probability"] is not None
    ]
    expected = [float(row["success_probability"]) for row in lifted]
    measures = error_ratios(_published()["surfaces"][1], "gpis")
    organic = [r for r in measures if (r.family, r.estimator) == ("organic", "blend")]
    bottles = where(_published()["heavy"][1], object="006_mustard_bottle")
    heavy = [
        sum(bool(row["held"]) for row in bottles if f"--hand {hand}" in row["command"])
        for hand in ("allegro", "wsg50")
    ]
    for sentence in (
        f"the four-finger hand holds {heavy[0]} of 6, the gripper {heavy[1]} of 6",
        f"{edges['blend']:.1f} mm with `blend`, {edges['lis']:.1f} mm with `lis`,"
        f" {edges['gpis']:.1f} mm with `gpis`",
        f"{ratios['truth_to_estimate']:.2f} times that of `gpis` from truth to estimate,"
        f" {ratios['estimate_to_truth']:.2f} from estimate to truth",
        f"{held['blend']:.0f} % of {len(where(once, estimator='blend'))} trials with `blend`,"
        f" {held['gpis']:.0f} % with `gpis`, {held['truth']:.0f} % on the true mesh",
        f"{several['blend']:.0f} % with `blend`, {several['gpis']:.0f} % with `gpis`,"
        f" {several['truth']:.0f} % on the true mesh",
        f"{hard['blend']:.0f} % with `blend`, {hard['gpis']:.0f} % with `gpis`,"
        f" {hard['truth']:.0f} % on the true mesh; with up to three attempts"
        " {blend:.0f}, {gpis:.0f} and {truth:.0f} %".format(**hard_several),
        f"Of tools {tools:.0f} % of grasps hold with `blend`, of twelve harder objects"
        f" {hard['blend']:.0f} %",
        f"Of single grasps on `blend` {100.0 * np.mean(expected):.0f} % should hold, and"
        f" {100.0 * np.mean([bool(row['held']) for row in lifted]):.0f} % do",
        f"On organic shapes the error is {summarise(organic, 'truth_to_estimate').mean:.2f} times",
    ):
        assert sentence in text


def test_numbers_of_the_readme_are_those_of_the_rows() -> None:
    text = _text(README)
    edges, held, several = _numbers("paper"), _numbers("grasps"), _numbers("grasps", 1)
    part, rows = _published()["grasps"]
    once = where(rows, attempts=1)
    tools = family_rates(once, part.objects)["tools", "blend"]
    assert several["blend"] == several["gpis"]
    for sentence in (
        f"Held: {held['blend']:.0f} % on `blend`, {held['gpis']:.0f} % on a Gaussian process"
        f" (`gpis`), {held['truth']:.0f} % on the true mesh, of"
        f" {len(where(once, estimator='blend'))} simulated trials each; with up to three attempts"
        f" {several['blend']:.0f} % on both estimates",
        f"`blend` is {edges['blend']:.1f} mm from them, `lis` {edges['lis']:.1f} mm and `gpis`"
        f" {edges['gpis']:.1f} mm",
        f"on tools {tools:.0f} % of single grasps held, on twelve harder objects"
        f" {_numbers('hard')['blend']:.0f} %",
    ):
        assert sentence in text
    assert held_rates(once)["blend"] == held["blend"]
    assert len(re.findall(r"\d+ %", text)) == 6
