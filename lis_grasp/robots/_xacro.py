"""Expansion of xacro's macros, in a process that imports nothing else."""

from __future__ import annotations

import contextlib
import json
import re
import resource
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots.model_uri import LISTS, package_folders

_EXPAND = "from lis_grasp.robots._xacro import _expand; _expand()"
_LONGEST = 30.0  # [s] that macros may take
_MOST_MEMORY = 4096 << 20  # bytes that they may need
# What xacro, or a file without links, says of an argument that is needed.
_ARGUMENT = re.compile(r"Undefined substitution argument (\S+)|make no links")


def has_macros(root: ET.Element) -> bool:
    """Return whether an XML tree has macros of xacro."""
    return any(
        "xacro}" in value or "${" in value or "$(" in value.replace("$(find ", "")
        for element in root.iter()
        for value in (element.tag, *element.attrib.values())
    )


def expand_macros(path: Path, given: Mapping[str, str]) -> ET.Element:
    """Return the URDF that xacro makes of a file with arguments by name.

    Packages are found as by `package_folders`.
    """
    try:
        import_module("xacro")
    except ImportError:
        raise InvalidHandError(
            f"{path} has xacro macros, read if xacro is installed (pip install xacro); or"
            f" convert it first, as by `xacro {path} > hand.urdf`",
            file=path.name,
        ) from None
    command = [sys.executable, "-c", _EXPAND, str(path.resolve()), json.dumps(dict(given))]
    try:  # in a process of its own: macros are a program, which may have no end
        done = subprocess.run(command, capture_output=True, timeout=_LONGEST, check=True)
        root = ET.fromstring(done.stdout)
        if root.tag != "robot" or root.find("link") is not None:
            return root
        reason = "they make no links"
    except subprocess.TimeoutExpired:
        reason = f"they have no end within {_LONGEST:.0f} s"
    except subprocess.CalledProcessError as error:
        reason = error.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    if asked := _ARGUMENT.search(reason):
        declared = re.findall(rb"<xacro:arg\s[^>]*?\bname=[\"']([^\"']+)", path.read_bytes())
        known = [name.decode(errors="replace") for name in dict.fromkeys(declared)]
        names = [asked[1]] if asked[1] else known
        asks = " ".join(f"{name}:=VALUE" for name in names)
        keys = ", ".join(f"{name}: VALUE" for name in names)
        reason += (
            f": give `xacro_args` {asks}, in a YAML file xacro_args: {{{keys}}}"
            if names
            else ": give the file that calls its macros"
        )
    raise InvalidHandError(f"{path} has macros that xacro cannot expand: {reason}", file=path.name)


def _expand() -> None:
    """Print the URDF of a file as the process of `expand_macros`, or exit with the reason."""
    path, given = Path(sys.argv[1]), _Arguments(json.loads(sys.argv[2]))
    with contextlib.suppress(OSError, ValueError):  # a lower limit holds, or the system has none
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, hard))
    functions = vars(import_module("xacro.substitution_args"))

    def find(package: str) -> str:
        above = [folder for folder in path.parents if folder.name == package]
        beside = [f / package for f in path.parents if (f / package).is_dir()]
        folders = [*above, *beside, *package_folders(package)]
        if not folders or not folders[0].is_dir():
            raise LookupError(
                f"no folder '{package}' is above the file or beside one that is: list the folder"
                f" that holds it in {' or '.join(LISTS)}"
            )
        return str(folders[0])

    functions["_eval_find"] = find
    try:
        text = import_module("xacro").process_file(str(path), mappings=given).toxml()
    # xacro raises errors of many types for what it cannot evaluate, some of which say it twice.
    except Exception as error:  # noqa: BLE001
        reason = re.sub(r"<class '[\w.]+'>: ", "", " ".join(str(error).split()))
        sys.exit(re.sub(r"^(.+) \1(?= when evaluating|$)", r"\1", reason) or type(error).__name__)
    if strange := set(json.loads(sys.argv[2])) - given.asked:
        known = ", ".join(sorted(given.asked)) or "none"
        sys.exit(f"it has no argument {', '.join(sorted(strange))}; its arguments are {known}")
    sys.stdout.write(text)


class _Arguments(dict[str, str]):
    """Arguments of a xacro file that remember for which ones it asked."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)
