"""Reading of a hand's links and joints from a URDF file (parsed by yourdfpy)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import defusedxml.ElementTree
import numpy as np
import yourdfpy
from defusedxml import DefusedXmlException

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.hands.link_tree import HandModel, build_hand_model


def read_urdf(path: Path) -> HandModel:
    """Read links, joints, inertias and collision bodies of a URDF; errors as `build_hand_model`."""
    # yourdfpy logs a syntax error and reads on; a hand that is half read must be refused.
    parse_xml(path)
    try:
        with np.errstate(all="ignore"):  # poses are checked one by one
            urdf = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False)
    except (AttributeError, LookupError, TypeError, ValueError, SyntaxError) as error:
        message = f"{path.name} is not a URDF that can be read: {error}"
        raise InvalidHandError(message, file=path.name) from None
    return build_hand_model(urdf.robot, path)


def parse_xml(path: Path) -> ET.Element:
    """Return the root of an XML file without entities; raise `InvalidFileError` for any other."""
    try:
        root: ET.Element = defusedxml.ElementTree.parse(path).getroot()
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    except DefusedXmlException:
        raise InvalidFileError(f"{path} must not declare XML entities", path=path) from None
    except (ET.ParseError, LookupError, ValueError) as error:
        raise InvalidFileError(f"{path} is not valid XML: {error}", path=path) from None
    return root
