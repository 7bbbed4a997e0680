"""The numbers of README and of the results page are those of the published rows."""

import re
from functools import cache
from pathlib import Path

import pytest

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.evaluation.configuration import Configuration
from lis_grasp_studies.evaluation.page import fill_template
from lis_grasp_studies.evaluation.results import EvaluationResults
from lis_grasp_studies.harness.parquet import read_parquet
from lis_grasp_studies.harness.tables import split

pytestmark = pytest.mark.experiments

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "docs" / "study"
TEMPLATE = STUDY / "results.md.in"

# What README says, in the fields of the template.
_README = (
    "a slot that is cut to the outline of a flat-faced object needs {tasks[ratio blend 40]:.2f}"
    " times the clearance of a Gaussian process (`gpis`) with `blend`, {tasks[ratio lis 40]:.2f}"
    " times with `lis`",
    "Held: {grasps[blend]:.0f} % on `blend`, {grasps[gpis]:.0f} % on `gpis`,"
    " {grasps[lis]:.0f} % on `lis`, {grasps[truth]:.0f} % on the true mesh, of {grasps[trials]}"
    " simulated trials each",
    "Tested by touch before the lift, as `run` does, in up to three attempts after twenty touches:"
    " {grasps[blend x3]:.0f} % on `blend`, {grasps[gpis x3]:.0f} % on `gpis`",
    "After one depth image and three touches {views[seen 3]:.0f} % of twelve other objects are"
    " held, after ten {views[seen 10]:.0f} %; without the image {views[blind 3]:.0f} and"
    " {views[blind 10]:.0f} %",
    "of tested grasps on tools {grasps[blend tools x3]:.0f} % held in up to three attempts, on"
    " twelve harder objects {hard[blend x3]:.0f} %",
)

# Numbers with units that no row has: the level of intervals.
_BY_HAND = {"95 %"}


@cache
def _published() -> tuple[Configuration, dict[str, list[Row]]]:
    """Return the configuration that was published, and the rows of its parts."""
    pytest.importorskip("pyarrow")
    found = split(EvaluationResults(STUDY).read(any_version=True), "part")
    configuration = Configuration.load(STUDY / "configuration.yaml")
    assert {*found} <= {*configuration.parts}
    return configuration, {name: found[name] for name in configuration.parts if name in found}


def _filled(template: Path) -> str:
    return fill_template(template, *_published(), read_parquet(STUDY / "rows-0.11.parquet"))


def _words(text: str) -> str:
    return " ".join(text.replace("**", "").split())


def test_rows_are_of_one_commit_but_for_views() -> None:
    # The views were measured again after a repair that only they meet.
    commits: dict[bool, set[tuple[str, str]]] = {False: set(), True: set()}
    for name, rows in _published()[1].items():
        commits[name.startswith("views")] |= {(row["version"], row["commit"]) for row in rows}
    assert [len(of) for of in commits.values()] == [1, 1]


def test_the_results_page_is_the_template_filled_from_the_rows() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert page == _filled(TEMPLATE)
    assert page.count("\n| --- |") > 12


def test_numbers_that_no_row_has_are_few_and_known() -> None:
    prose = re.sub(r"\{[^}]*\}", " ", _words(TEMPLATE.read_text(encoding="utf-8")))
    assert {*re.findall(r"[\d.]+ (?:%|ms|s|times)(?!\w)", prose)} <= _BY_HAND


def test_numbers_of_the_readme_are_those_of_the_rows(tmp_path: Path) -> None:
    text = _words((ROOT / "README.md").read_text(encoding="utf-8"))
    template = tmp_path / "readme"
    template.write_text("\n".join(_README))
    for sentence in _filled(template).splitlines():
        assert sentence in text
        text = text.replace(sentence, "")
    assert not re.findall(r"\d %|\d mm", text)


def test_a_field_that_no_row_fills_is_named(tmp_path: Path) -> None:
    template = tmp_path / "page"
    fields = ["{grasps[nobody]:.0f}", "{tables[lies.lies]:nothing}", "{state.nothing}"]
    for field in (*fields, "{nothing"):
        template.write_text(field)
        with pytest.raises(InvalidFileError) as error:
            _filled(template)
        assert error.value.path == template
