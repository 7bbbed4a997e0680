"""The numbers of README and of the results page are those of the published rows."""

import re
from functools import cache
from operator import itemgetter
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
    "Held: {grasps[blend]:.0f} % on `blend`, {grasps[gpis]:.0f} % on a Gaussian process (`gpis`),"
    " {grasps[lis]:.0f} % on `lis`, {grasps[truth]:.0f} % on the true mesh, of {grasps[trials]}"
    " simulated trials each; with up to three attempts {grasps[blend x3]:.0f} % on `blend` and"
    " {grasps[gpis x3]:.0f} % on `gpis`",
    "`blend` is {paper[blend]:.1f} mm from them, `lis` {paper[lis]:.1f} mm and `gpis`"
    " {paper[gpis]:.1f} mm",
    "on tools {grasps[blend tools]:.0f} % of single grasps held, on twelve harder objects"
    " {hard[blend]:.0f} %",
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


def test_all_rows_are_of_one_commit() -> None:
    rows = [row for of in _published()[1].values() for row in of]
    assert len({(row["version"], row["commit"]) for row in rows}) == 1


def test_the_results_page_is_the_template_filled_from_the_rows() -> None:
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert page == _filled(TEMPLATE)
    assert page.count("\n| --- |") > 12


def test_the_page_counts_the_trials_repeated_after_a_repaired_fault() -> None:
    key = itemgetter("object", "hand", "touches", "attempts")
    published = _published()[1]
    before = {
        key(r): r for r in (*published["grasps"], *published["hard"]) if r["estimator"] == "blend"
    }
    after = [r for r in read_parquet(STUDY / "rows-retreat.parquet") if r["attempts"] == 1]
    pairs = [(before[key(row)], row) for row in after]
    changed = [a["contacts_digest"] != b["contacts_digest"] for a, b in pairs]
    assert all(a["held"] == b["held"] for (a, b), c in zip(pairs, changed, strict=True) if not c)
    old, new = (sum(pair[i]["held"] for pair in pairs) for i in (0, 1))
    text = _words(TEMPLATE.read_text(encoding="utf-8"))
    assert f"Of {len(pairs)} single grasps" in text
    assert f"{sum(changed)} have other contacts; {new} instead of {old} hold." in text


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
    fields = ["{grasps[nobody]:.0f}", "{lies_errors[objects]}", "{tables[lies.lies]:nothing}"]
    for field in (*fields, "{state.nothing}", "{grasps:>9}", "{nothing", "{}"):
        template.write_text(field)
        with pytest.raises(InvalidFileError, match=r"nobody|lies_errors|nothing|[Ff]ormat|\}"):
            _filled(template)
