"""Reading of a hand's links and joints from a URDF file (parsed by yourdfpy)."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import defusedxml.ElementTree
import numpy as np
import yourdfpy
from defusedxml import DefusedXmlException

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.io.limits import MEBIBYTE, require_file_size

_MOST_BYTES = 64 * MEBIBYTE  # of a URDF or SDF that is read
_NAMESPACES = {b"drake": b"http://drake.mit.edu"}


def parse_urdf(path: Path) -> yourdfpy.Robot:
    """Return the links and joints that a URDF describes, unchecked."""
    # yourdfpy logs a syntax error and reads on; a hand that is half read must be refused.
    root = parse_xml(path)
    _require_no_macros(root, path)
    text = io.BytesIO(ET.tostring(root))
    try:
        with np.errstate(all="ignore"):  # poses are checked one by one
            urdf = yourdfpy.URDF.load(text, build_scene_graph=False, load_meshes=False)
    # On descriptions of another structure yourdfpy raises errors of a dozen built-in types.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        message = f"{path.name} is not a URDF that can be read: {reason}"
        raise InvalidHandError(message, file=path.name) from None
    return urdf.robot


def _require_no_macros(root: ET.Element, path: Path) -> None:
    """Raise `InvalidHandError` for a xacro file, from which a URDF is made first."""
    for element in root.iter():
        values = (element.tag, *element.attrib.values())
        if any("xacro}" in value or "${" in value or "$(" in value for value in values):
            raise InvalidHandError(
                f"{path.name} must be a URDF; it has xacro macros: convert it first, as by"
                f" `xacro {path.name} > hand.urdf` (pip install xacro)",
                file=path.name,
            )


def parse_xml(path: Path) -> ET.Element:
    """Return the root of an XML file without entities; raise `InvalidFileError` for any other.

    A prefix of elements that the file does not declare is taken as declared, and ``drake:`` of
    attributes, too.
    """
    try:
        require_file_size(path, _MOST_BYTES)
        text = path.read_bytes()
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
        raise InvalidFileError(f"{path} is not valid XML: {error}", path=path) from None
    return root


def _with_prefixes(text: bytes) -> bytes:
    """Declare all prefixes of names that an XML text uses at its root element."""
    used = set(re.findall(rb"<(\w+):\w", text)) | set(re.findall(rb"\s(drake):\w+=", text))
    used -= set(re.findall(rb"xmlns:(\w+)=", text))
    names = b"".join(
        b' xmlns:%s="%s"' % (prefix, _NAMESPACES.get(prefix, b"urn:" + prefix))
        for prefix in sorted(used)
    )
    return re.sub(rb"<\w[\w.-]*", lambda root: root.group() + names, text, count=1)
