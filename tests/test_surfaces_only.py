"""The packages that the install page names for surfaces only are enough for them."""

import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

_REPOSITORY = Path(__file__).parent.parent
_ESTIMATE = """
import sys

sys.modules.update(dict.fromkeys(sys.argv[2:]))  # None: as if not installed
import lis_grasp as lg

mesh = lg.extract_mesh(lg.estimate(lg.load_contacts(sys.argv[1]), support_height=0.0))
print(mesh.is_watertight)
"""


def _with_what_they_require(names: list[str]) -> set[str]:
    """Return distributions, and those that they require without an extra, by canonical names."""
    found: set[str] = set()
    waiting = [canonicalize_name(name) for name in names]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        try:
            needed = [Requirement(text) for text in requires(name) or ()]
        except PackageNotFoundError:  # for another system
            continue
        waiting += [
            canonicalize_name(r.name)
            for r in needed
            if r.marker is None or r.marker.evaluate({"extra": ""})
        ]
    return found


def test_the_named_packages_are_enough_for_a_surface() -> None:
    page = (_REPOSITORY / "docs" / "install.md").read_text(encoding="utf-8")
    [names] = re.findall(r"--no-deps \.\n.* pip install (.*)", page)
    allowed = _with_what_they_require(names.split()) | {"lis-grasp"}
    refused = {
        module
        for module, distributions in packages_distributions().items()
        if not allowed & {canonicalize_name(name) for name in distributions}
    }
    assert {"pydrake", "yourdfpy", "shapely"} <= refused
    contacts = str(_REPOSITORY / "examples" / "contacts.csv")
    command = [sys.executable, "-c", _ESTIMATE, contacts, *sorted(refused)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (made.returncode, made.stdout) == (0, "True\n"), made.stderr
