"""Check that the project is ready to be released as a version, and print the notes of it.

python .ci/release.py 0.6.0 > notes.md      # exit code 1 and a sentence if something is missing
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main(version: str, root: Path = ROOT) -> int:
    """Print the notes of a version, or what is missing; return the exit code."""
    mistakes = list(mistakes_of(version.removeprefix("v"), root))
    for mistake in mistakes:
        print(mistake, file=sys.stderr)
    if not mistakes:
        print(notes_of(version.removeprefix("v"), root))
    return int(bool(mistakes))


def mistakes_of(version: str, root: Path) -> list[str]:
    """Return a sentence for each file that is not of the version."""
    found = {
        "lis_grasp/version.py": _first(root, "lis_grasp/version.py", r'__version__ = "([^"]+)"'),
        "CITATION.cff": _first(root, "CITATION.cff", r"^version: (\S+)"),
        "CHANGELOG.md, with a date,": _first(
            root, "CHANGELOG.md", r"^## (\S+) \(\d{4}-\d\d-\d\d\)$"
        ),
    }
    wrong = [
        f"{f} must name version {version}; it names {v}" for f, v in found.items() if v != version
    ]
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    if re.search(r"^## .*unreleased", changelog, re.IGNORECASE | re.MULTILINE):
        wrong.append("CHANGELOG.md must have no unreleased changes; it has some")
    return wrong


def notes_of(version: str, root: Path) -> str:
    """Return the changelog's section of a version, without its heading."""
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = re.search(
        rf"^## {re.escape(version)} [^\n]*\n(.*?)(?=^## |\Z)", changelog, re.DOTALL | re.MULTILINE
    )
    return section[1].strip() if section else ""


def _first(root: Path, file: str, pattern: str) -> str | None:
    match = re.search(pattern, (root / file).read_text(encoding="utf-8"), re.MULTILINE)
    return match[1] if match else None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
