"""Reading of robot descriptions as XML, and of links and joints of a URDF (by yourdfpy)."""

from __future__ import annotations

import contextlib
import io
import json
import re
import resource
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

import defusedxml.ElementTree
import numpy as np
import yourdfpy
from defusedxml import DefusedXmlException

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.io.content_kinds import require_kind
from lis_grasp.io.limits import MEBIBYTE, reason_of, require_file_size
from lis_grasp.robots.model_uri import LISTS, package_folders

_MOST_BYTES = 64 * MEBIBYTE  # of a URDF, SDF or MJCF that is read
_NAMESPACES = {b"drake": b"http://drake.mit.edu"}
_START = 400  # bytes in which XML names its encoding
_EXPAND = "from lis_grasp.robots._urdf import _expand; _expand()"
_LONGEST = 30.0  # [s] that macros may take
_MOST_MEMORY = 4096 * MEBIBYTE  # that they may need
# What xacro, or a file without links, says of an argument that is needed.
_ARGUMENT = re.compile(r"Undefined substitution argument (\S+)|make no links")


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put a file's path before the message of an `InvalidHandError` that names no file or key."""
    try:
        yield
    except InvalidHandError as error:
        if error.file or error.key:  # a key is of the YAML, which edits the description
            raise
        raise InvalidHandError(f"{path}: {error}", file=path.name) from None


def parse_urdf(root: ET.Element, path: Path) -> yourdfpy.Robot:
    """Return the links and joints that a URDF describes, unchecked."""
    # yourdfpy logs a syntax error and reads on; a hand that is half read must be refused.
    for kind in ("link", "joint"):
        require_unique_names(root.findall(kind), path)
        for element in root.findall(kind):
            _require_complete(element, path)
    text = io.BytesIO(ET.tostring(root))
    try:
        with np.errstate(all="ignore"):  # poses are checked one by one
            urdf = yourdfpy.URDF.load(text, build_scene_graph=False, load_meshes=False)
    # On descriptions of another structure yourdfpy raises errors of a dozen built-in types.
    except Exception as error:  # noqa: BLE001
        reason = reason_of(error, "URDF")
        if "number is needed" in reason:
            reason += ": write numbers with a decimal point, and blanks between"
        message = f"{path} is not a URDF that can be read: {reason}"
        raise InvalidHandError(message, file=path.name) from None
    return urdf.robot


def _require_complete(owner: ET.Element, path: Path) -> None:
    """Raise `InvalidHandError` if a link or a joint lacks what yourdfpy takes for granted."""
    ends = ("parent", "child") if owner.tag == "joint" else ()
    missing = [f"<{end}>" for end in ends if owner.find(end) is None]
    missing += ["a shape in <geometry>" for each in owner.iter("geometry") if not len(each)]
    triples = [(n, e.get(n)) for e in owner.iter() for n in ("xyz", "rpy")]
    missing += [f"three numbers in {n}='{t}'" for n, t in triples if t and len(t.split()) != 3]
    if missing:
        named = f"the {owner.tag} '{owner.get('name', '')}'"
        raise InvalidHandError(f"{path}: {named} lacks {', '.join(missing)}", file=path.name)


def require_unique_names(elements: Iterable[ET.Element], path: Path) -> None:
    """Raise `InvalidHandError` if two links, or two joints, have one name."""
    counts = Counter((element.tag, element.get("name", "")) for element in elements)
    for (kind, name), count in counts.items():
        if count > 1:
            raise InvalidHandError(
                f"{path}: {count} {kind}s are named '{name}': give each its own name",
                file=path.name,
            )


def _has_macros(root: ET.Element) -> bool:
    return any(
        "xacro}" in value or "${" in value or "$(" in value.replace("$(find ", "")
        for element in root.iter()
        for value in (element.tag, *element.attrib.values())
    )


def _expand_macros(path: Path, given: Mapping[str, str]) -> ET.Element:
    """Return the URDF that xacro makes of a file; packages are found as by `package_folders`."""
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
        done = subprocess.run(command, capture_output=True, timeout=_LONGEST, check=False)
    except subprocess.TimeoutExpired:
        reason = f"they have no end within {_LONGEST:.0f} s"
    else:
        if not done.returncode:
            root = ET.fromstring(done.stdout)
            if root.tag != "robot" or root.find("link") is not None:
                return root
            reason = "they make no links"
        else:
            reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    if asked := _ARGUMENT.search(reason):
        names = [asked[1]] if asked[1] else _arguments(path)
        asks = " ".join(f"{name}:=VALUE" for name in names)
        keys = ", ".join(f"{name}: VALUE" for name in names)
        reason += (
            f": give `xacro_args` {asks}, in a YAML file xacro_args: {{{keys}}}"
            if names
            else ": give the file that calls its macros"
        )
    message = f"{path} has macros that xacro cannot expand: {reason}"
    raise InvalidHandError(message, file=path.name)


def _arguments(path: Path) -> list[str]:
    """Return the names of the arguments that a xacro file declares."""
    found = re.findall(rb"<xacro:arg\s[^>]*?\bname=[\"']([^\"']+)", path.read_bytes())
    return [name.decode(errors="replace") for name in dict.fromkeys(found)]


def _expand() -> None:
    """Print the URDF of a file as the process of `_expand_macros`, or exit with the reason."""
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


def parse_xml(path: Path, xacro_args: Mapping[str, str] = MappingProxyType({})) -> ET.Element:
    """Return the root of an XML file without entities; raise `InvalidFileError` for any other.

    Macros of xacro are expanded, with arguments by name, if it is installed; otherwise they raise
    `InvalidHandError`.
    A prefix of elements that the file does not declare is taken as declared, and ``drake:`` of
    attributes, too. Lines before the XML declaration, such as comments or a program's warnings, are
    left out.
    """
    try:
        require_file_size(path, _MOST_BYTES)
        text = path.read_bytes()
        require_kind(path, "a URDF, SDF or MJCF")
        text = re.sub(rb"\A([^<]|<!--.*?-->)+(?=<\?xml)", b"", text, flags=re.DOTALL)
        try:
            root: ET.Element = defusedxml.ElementTree.fromstring(text)
        except ET.ParseError as error:
            if "unbound prefix" not in str(error):
                raise
            root = defusedxml.ElementTree.fromstring(_with_prefixes(text))
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    except DefusedXmlException:
        raise InvalidFileError(f"{path} must not declare XML entities", path=path) from None
    except (ET.ParseError, LookupError, ValueError) as error:
        reason = _reason(text, error)
        raise InvalidFileError(f"{path} is not valid XML: {reason}", path=path) from None
    if _has_macros(root):
        return _expand_macros(path, xacro_args)
    if xacro_args:
        raise InvalidHandError(
            f"{path} must have xacro macros for the arguments {', '.join(xacro_args)}; it has none:"
            " leave out `xacro_args`",
            file=path.name,
        )
    return root


def _reason(text: bytes, error: Exception) -> str:
    """Return why an XML text is not valid, and what to do."""
    if any(b"--" in comment for comment in re.findall(rb"<!--(.*?)-->", text, re.DOTALL)):
        return "a comment must not contain '--'"
    if text.strip() and not text.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return "it does not begin with <: give a URDF, SDF or MJCF"
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        if b"encoding" not in text[:_START]:
            return "its letters are not in UTF-8: save it as UTF-8"
    if "no element found" in str(error) or "unclosed" in str(error):
        return "it is cut off: download or export it again"
    if "unbound prefix" in str(error):
        return "it has a name whose prefix it does not declare"
    return reason_of(error, "XML")


def _with_prefixes(text: bytes) -> bytes:
    """Declare all prefixes of names that an XML text uses at its root element."""
    used = set(re.findall(rb"<(\w+):\w", text)) | set(re.findall(rb"\s(drake):\w+=", text))
    used -= set(re.findall(rb"xmlns:(\w+)=", text))
    names = b"".join(
        b' xmlns:%s="%s"' % (prefix, _NAMESPACES.get(prefix, b"urn:" + prefix))
        for prefix in sorted(used)
    )
    return re.sub(rb"<\w[\w.-]*", lambda root: root.group() + names, text, count=1)
