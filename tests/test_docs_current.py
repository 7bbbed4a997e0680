"""Documentation that has become stale: versions, defaults, options, files, names and counts."""

import argparse
import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

import lis_grasp
from lis_grasp.cli.main import build_parser
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import POLICIES, pose_tracking
from lis_grasp.exploration.probe import ProbeStatus
from lis_grasp.pipeline import RunConfig
from lis_grasp.probing import approach_planner, guarded_motion, probe_planner
from lis_grasp.results import summary
from lis_grasp.results.placed import PLACE_REASONS
from lis_grasp.robots.shipped_models import READY_HANDS, VENDOR_HANDS
from lis_grasp.shapes import NAMES
from lis_grasp.simulation.drake import dynamic_prober
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp_studies.contact_study.contact_sets import CASES
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT, EVALUATION

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")),
    *sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts),
    *sorted((ROOT / "notebooks").glob("*.ipynb")),
)
_NUMBERS = (
    *("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"),
    *("eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen"),
    *("nineteen", "twenty"),
)
# Groups of entry points, in which other packages name their plug-ins.
_ENTRY_POINTS = (
    "lis_grasp.estimators",
    "lis_grasp.policies",
    "lis_grasp.planners",
    "lis_grasp.hands",
    "lis_grasp.verbs",
)


@cache
def _text(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = json.loads(text)["cells"]
    return "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def _found(pattern: str) -> list[tuple[str, str]]:
    """Return the page and the first group of each match."""
    return [
        (page.relative_to(ROOT).as_posix(), match)
        for page in PAGES
        for match in re.findall(pattern, _text(page))
    ]


def test_the_citation_and_the_changelog_name_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == lis_grasp.__version__
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released = re.findall(r"^## (\S+) \(\d{4}-\d\d-\d\d\)$", changelog, re.MULTILINE)
    assert released[0] == lis_grasp.__version__
    assert changelog.count("(unreleased)") <= 1


def test_no_page_names_a_later_version() -> None:
    def parts(version: str) -> list[int]:
        return [int(part) for part in version.split(".")]

    named = _found(r"\bversion (\d+\.\d+(?:\.\d+)?)\b")
    assert len(named) > 3
    later = [name for name in named if parts(name[1]) > parts(lis_grasp.__version__)]
    assert not [name for name in later if name[1].split(".")[0] == "0"], later


def test_every_reason_is_explained() -> None:
    page = _text(DOCS / "reference" / "reasons.md")
    tables = (summary.REJECTIONS, summary.LIFT_REASONS, PLACE_REASONS)
    sentences = [pair for table in tables for pair in table.items()]
    missing = [row for pair in sentences if (row := "| `{}` | {} |".format(*pair)) not in page]
    assert not missing, "\n".join(missing)
    named = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    assert named == {*dict(sentences), *get_args(ProbeStatus)}
    of_probes = [approach_planner.NO_FREE_START, approach_planner.NO_FREE_APPROACH]
    of_probes += [approach_planner.OUT_OF_ARM_REACH, probe_planner.NO_ARM_TRANSIT]
    of_probes += [
        guarded_motion.AT_TABLE,
        pose_tracking.MOVED,
        pose_tracking.LOST,
        pose_tracking.JOINED,
    ]
    of_probes += [dynamic_prober.ARM_STOPPED, dynamic_prober.GRAZED]
    assert not [reason for reason in of_probes if f"| {reason} |" not in page]


def test_defaults_are_those_of_the_configuration() -> None:
    defaults = RunConfig()
    named = [
        *_found(r"`(\w+)`,? (?:\(default\)|\(the default\)|the default\b|the package's default)"),
        *_found(r"the default (?:estimator|policy|hand),? `(\w+)`"),
        *_found(r"`(\w+)`,? the default (?:estimator|policy|hand)"),
        *_found(r"default (?:estimator|policy|hand) is `(\w+)`"),
    ]
    assert len(named) >= 4
    kinds = {"estimator": ESTIMATORS, "policy": POLICIES, "hand": READY_HANDS}
    for page, name in named:
        (option,) = (option for option, names in kinds.items() if name in names)
        assert getattr(defaults, option) == name, page


@cache
def _options() -> dict[str, set[str]]:
    """Return the options of each verb; "" for those of all verbs and of other programs here."""
    (verbs,) = (a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    options: dict[str, set[str]] = {}
    for verb, parser in verbs.choices.items():
        nested = [parser]
        nested += [
            parser_of_verb
            for action in parser._actions
            if isinstance(action, argparse._SubParsersAction)
            for parser_of_verb in action.choices.values()
        ]
        options[verb] = {name for p in nested for a in p._actions for name in a.option_strings}
    scripts = [*(ROOT / "benchmarks").glob("*.py"), *(ROOT / "tests/robustness").glob("*.py")]
    scripts += [*(ROOT / "lis_grasp_studies").rglob("*.py")]
    elsewhere = set().union(*(re.findall(r"--[a-z][\w-]+", _text(script)) for script in scripts))
    return options | {"": set().union(*options.values(), elsewhere)}


def test_options_in_commands_exist() -> None:
    commands = _found(r"lis-grasp ((?:[a-z]+) [^`\n#)]*)")
    assert len(commands) > 60
    for page, command in commands:
        verb, *_ = command.split()
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", command):
            assert option in _options().get(verb, _options()[""]), f"{page}: {verb} {option}"


def test_options_named_alone_exist() -> None:
    named = _found(r"`(--[a-z][a-z-]+)[^`]*`")
    assert len(named) > 60
    others = {"--nthreads", "--lifetime", "--user"}  # of Dask and Docker
    for page, option in named:
        assert option in _options()[""] | others, f"{page}: {option}"


def test_a_row_of_a_table_is_one_line() -> None:
    assert not _found(r"\n(\|[^\n]*[^|\s][ ]*)\n")


def test_named_files_of_the_project_exist() -> None:
    folders = "lis_grasp|tests|benchmarks|examples|models|notebooks|docs"
    named = _found(rf"`((?:{folders})/[\w./-]+)`")
    assert len(named) > 20
    for page, name in named:
        assert (ROOT / name).exists() or "/_build" in name, f"{page}: {name}"


def test_links_of_pages_outside_the_site_lead_somewhere() -> None:
    for page in (path for path in PAGES if DOCS not in path.parents and path.suffix == ".md"):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", _text(page)):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_rows_of_tables_are_lines() -> None:
    for page in PAGES:
        rows = [line for line in _text(page).splitlines() if line.startswith("| ")]
        assert [line for line in rows if not line.endswith(" |")] == [], page.name


def _module_of(name: str) -> tuple[Any, str] | None:
    """Return the module in a dotted name and the rest, or None if it needs a missing extra."""
    module = name
    while module:
        try:
            return import_module(module), name[len(module) + 1 :]
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith("lis_grasp"):
                return None
            module = module.rpartition(".")[0]
        except InvalidOptionError as error:
            if "pip install 'lis-grasp[" in str(error):
                return None
            raise
    raise AssertionError(f"{name}: no such module")


def test_named_python_objects_exist() -> None:
    named = _found(r"`~?(lis_grasp(?:\.\w+)+)`")
    assert len(named) > 15
    listed = re.compile(r"^\.\. auto\w+:: ([\w.]+)(?:\(\))?$", re.MULTILINE)
    for page in DOCS.rglob("*.rst"):
        named += [(page.name, name) for name in listed.findall(_text(page))]
    assert len(named) > 50
    for page, name in (item for item in named if item[1] not in _ENTRY_POINTS):
        found = _module_of(name)
        if found is None:
            continue
        owner, attributes = found
        for attribute in filter(None, attributes.split(".")):
            assert hasattr(owner, attribute), f"{page}: {name}"
            owner = getattr(owner, attribute)


def _number(word: str) -> int:
    plain = word.replace(",", "").replace(" ", "")
    return int(plain) if plain.isdecimal() else _NUMBERS.index(word.lower())


def _objects(families: Mapping[Any, Sequence[str]]) -> int:
    return sum(map(len, families.values()))


_VERBS = "docs/reference/command-line.md"
# Counts in prose: a pattern with the number, and what it must be.
_COUNTS: tuple[tuple[str, str, Callable[[], int]], ...] = (
    ("docs/hands.md", r"(\w+) vendors' hands are ready", lambda: len(VENDOR_HANDS)),
    ("docs/results.md", r"the (\w+) built-in shapes", lambda: len(NAMES)),
    (_VERBS, r"on the (\d+) objects of the default", lambda: _objects(EVALUATION)),
    (_VERBS, r"are the (\d+) others", lambda: _objects(DEVELOPMENT)),
    (
        "docs/reference/command-line.md",
        r"a quarter of the (\d+) cases of contacts",
        lambda: len(CASES),
    ),
)


@pytest.mark.parametrize(("page", "pattern", "count"), _COUNTS)
def test_counts_in_prose_are_those_of_the_code(
    page: str, pattern: str, count: Callable[[], int]
) -> None:
    (number,) = re.findall(pattern, re.sub(r"\s+", " ", _text(ROOT / page)))
    assert _number(number) == count(), page
