"""Every numeric constant of the core is in the table of constants, with its kind and effect."""

import ast
import csv
import re
from pathlib import Path

import pytest

import lis_grasp

PACKAGE = Path(lis_grasp.__file__).resolve().parent
TABLES = Path(__file__).parents[1] / "docs" / "constants"
_CONSTANT = r"_?[A-Z][A-Z0-9_]*"
KINDS = {"physical", "tolerance", "fitted", "heuristic", "appearance"}
COLUMNS = ["constant", "file", "kind", "value", "meaning", "off", "effect", "verdict"]


def _tables() -> dict[str, list[dict[str, str]]]:
    tables = {}
    for path in sorted(TABLES.glob("*.csv")):
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file, strict=True)
            tables[path.stem] = list(reader)
            assert reader.fieldnames == COLUMNS, path
    return tables


def _constants(path: Path) -> dict[str, bool]:
    """Return a file's module-level constants, and whether their values have numbers."""
    constants = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [name.id for t in targets for name in ast.walk(t) if isinstance(name, ast.Name)]
        is_numeric = any(
            isinstance(part, ast.Constant) and type(part.value) in (int, float)
            for part in ast.walk(node.value)
            if not isinstance(part, ast.Subscript)
        )
        constants |= {name: is_numeric for name in names if re.fullmatch(_CONSTANT, name)}
    return constants


def test_the_tables_list_every_numeric_constant() -> None:
    listed: dict[str, set[str]] = {}
    for row in (row for table in _tables().values() for row in table):
        if row["verdict"] != "deleted":
            names = [name for name in row["constant"].split(", ") if re.fullmatch(_CONSTANT, name)]
            listed.setdefault(row["file"], set()).update(names)
    for path in sorted(PACKAGE.rglob("*.py")):
        file = path.relative_to(PACKAGE).as_posix()
        constants, rows = _constants(path), listed.pop(file, set())
        unlisted = {name for name, is_numeric in constants.items() if is_numeric} - rows
        assert not unlisted, f"add these of {file} to docs/constants"
        assert rows <= set(constants), f"give those of {file} that are gone the verdict deleted"
    assert not any(listed.values()), f"files without these constants: {listed}"


def test_the_page_counts_the_heuristics_that_were_not_switched_off() -> None:
    rows = [row for table in _tables().values() for row in table]
    kept = [row for row in rows if row["kind"] == "heuristic" and row["verdict"] == "kept"]
    untried = sum("not switched off" in row["effect"] for row in kept)
    page = (TABLES.parent / "constants.md").read_text(encoding="utf-8")
    assert f"Of {len(kept)} rows in use, {untried} were not switched off." in page


@pytest.mark.parametrize("room", sorted(_tables()))
def test_a_heuristic_says_what_its_absence_changes(room: str) -> None:
    for row in _tables()[room]:
        name = f"{row['file']}: {row['constant']}"
        assert row["kind"] in KINDS, name
        assert row["verdict"] in {"kept", "deleted", "replaced"}, name
        assert row["meaning"], name
        if row["kind"] == "heuristic":
            assert row["effect"], name
