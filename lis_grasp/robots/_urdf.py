"""Reading of robot descriptions as XML, and of links and joints of a URDF (by yourdfpy)."""

from __future__ import annotations

import contextlib
import io
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import defusedxml.ElementTree
import numpy as np
import yourdfpy
from defusedxml import DefusedXmlException

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.io.content_kinds import require_kind
from lis_grasp.io.limits import MEBIBYTE, reason_of, require_file_size
from lis_grasp.robots._xacro import expand_macros, has_macros

_MOST_BYTES = 64 * MEBIBYTE  # of a URDF, SDF or MJCF that is read
_NAMESPACES = {b"drake": b"http://drake.mit.edu"}
_START = 400  # bytes in which XML names its encoding


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
        raise InvalidHandError(
            f"{path} is not a URDF that can be read: {reason}", file=path.name
        ) from None
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
        raise InvalidFileError.unreadable(path, error) from None
    except DefusedXmlException:
        raise InvalidFileError(f"{path} must not declare XML entities", path=path) from None
    except (ET.ParseError, LookupError, ValueError) as error:
        reason = _reason(text, error)
        raise InvalidFileError(f"{path} is not valid XML: {reason}", path=path) from None
    if has_macros(root):
        return expand_macros(path, xacro_args)
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
