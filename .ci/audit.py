"""Evaluate a report of `pip-audit --format json`: exit code 1 on a known vulnerability.

    python .ci/audit.py audit.json

A machine without access to the vulnerability data makes no report, or one that skips all packages.
Then this prints that nothing was audited, and passes.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def audit(report: str) -> tuple[list[str], bool]:
    """Return lines to print, and whether the audit passed."""
    if not report.strip():
        return ["NOT AUDITED: there is no report; vulnerability data cannot be reached"], True
    packages = json.loads(report)["dependencies"]
    skipped = [package["name"] for package in packages if "skip_reason" in package]
    audited = [package for package in packages if "skip_reason" not in package]
    lines = [
        f"VULNERABLE: {package['name']} {package['version']}: {vulnerability['id']}, fixed in"
        f" {', '.join(vulnerability['fix_versions']) or 'no version yet'}"
        for package in audited
        for vulnerability in package["vulns"]
    ]
    if not audited:
        return [f"NOT AUDITED: no vulnerability data for any of {len(skipped)} packages"], True
    without = f"; without data: {', '.join(skipped)}" if skipped else ""
    return [*lines, f"{len(audited)} packages audited{without}"], not lines


if __name__ == "__main__":
    printed, passed = audit(Path(sys.argv[1]).read_text(encoding="utf-8"))
    print("\n".join(printed))
    sys.exit(not passed)
