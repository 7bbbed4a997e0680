"""The step that audits dependencies fails on a known vulnerability, and only on that."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import pytest

AUDIT = Path(__file__).parent.parent / ".ci" / "audit.py"
if not AUDIT.exists():
    pytest.skip("needs the repository", allow_module_level=True)
judge = runpy.run_path(str(AUDIT))["judge"]

SOUND = {"name": "numpy", "version": "2.2.0", "vulns": []}
SKIPPED = {"name": "lis-grasp", "skip_reason": "Dependency not found"}
VULNERABLE = {
    "name": "pyyaml",
    "version": "5.3",
    "vulns": [{"id": "PYSEC-2021-142", "fix_versions": ["5.4"], "aliases": []}],
}


def report(*packages: dict[str, object]) -> str:
    return json.dumps({"dependencies": packages, "fixes": []})


def test_a_known_vulnerability_fails_and_is_named() -> None:
    lines, fine = judge(report(SOUND, VULNERABLE, SKIPPED))
    assert not fine
    assert lines[0] == "VULNERABLE: pyyaml 5.3: PYSEC-2021-142, mended in 5.4"


def test_sound_packages_pass_and_those_without_data_are_named() -> None:
    assert judge(report(SOUND, SKIPPED)) == (
        ["1 packages audited; without data: lis-grasp"],
        True,
    )


@pytest.mark.parametrize("text", ["", report(SKIPPED, SKIPPED)])
def test_where_no_data_can_be_reached_it_is_said(text: str) -> None:
    lines, fine = judge(text)
    assert fine
    assert lines[0].startswith("NOT AUDITED")
