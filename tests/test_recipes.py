"""Recipes of CONTRIBUTING: the files that a change touches exist, and define the names given."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
if not (ROOT / "CONTRIBUTING.md").exists():
    pytest.skip("needs the repository", allow_module_level=True)
_PLACE = re.compile(r"(?:a (?:file|folder) of its own in )?`([\w./-]+)`(?:: (.+))?")


def _recipes() -> dict[str, list[tuple[str, list[str]]]]:
    """Return the places of each change: a path from the root, and the names that it defines."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = page.split("## Where to change what")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    recipes = {}
    for change, places in rows[1:]:
        found = [_PLACE.fullmatch(place) for place in places.split("; ")]
        assert all(found), places
        recipes[change] = [(m[1], re.findall(r"`(\w+)`", m[2] or "")) for m in found if m]
    return recipes


def _defined(path: Path) -> set[str]:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    kinds = (ast.FunctionDef, ast.ClassDef)
    return {node.name for node in nodes if isinstance(node, kinds)} | {
        node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }


def test_the_typical_changes_have_a_recipe() -> None:
    changes = " ".join(_recipes())
    for word in ("estimator", "policy", "stop rule", "hand", "quality", "simulator", "mesh"):
        assert word in changes
    for word in ("points", "option", "squeeze", "layer", "noise"):
        assert word in changes


@pytest.mark.parametrize("change", _recipes())
def test_the_files_of_a_recipe_exist_and_define_its_names(change: str) -> None:
    for place, names in _recipes()[change]:
        path = ROOT / place
        assert path.exists(), place
        assert not names or {*names} <= _defined(path), (place, names)
