"""Dependency audit of the CI: it fails on a known vulnerability and on nothing else."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import pytest

AUDIT = Path(__file__).parent.parent / ".ci" / "audit.py"
if not AUDIT.exists():
    pytest.skip("needs the repository", allow_module_level=True)
audit = runpy.run_path(str(AUDIT))["audit"]

SOUND = {"name": "numpy", "version": "2.2.0", "vulns": []}
SKIPPED = {"name": "lis-grasp", "skip_reason": "Dependency not found"}
VULNERABLE = {
    "name": "pyyaml",
    "version": "5.3",
    "vulns": [{"id": "PYSEC-2021-142", "fix_versions": ["5.4"], "aliases": []}],
}


def report(*packages: dict[str, object]) -> str:
    return json.dumps({"dependencies": packages, "fixes": []})


def test_a_known_vulnerability_fails_by_name() -> None:
    lines, passed = audit(report(SOUND, VULNERABLE, SKIPPED))
    assert not passed
    assert lines[0] == "VULNERABLE: pyyaml 5.3: PYSEC-2021-142, fixed in 5.4"


def test_sound_packages_pass_and_packages_without_data_are_listed() -> None:
    assert audit(report(SOUND, SKIPPED)) == (
        ["1 packages audited; without data: lis-grasp"],
        True,
    )


@pytest.mark.parametrize("text", ["", report(SKIPPED, SKIPPED)])
def test_missing_vulnerability_data_is_reported(text: str) -> None:
    lines, passed = audit(text)
    assert passed
    assert lines[0].startswith("NOT AUDITED")
