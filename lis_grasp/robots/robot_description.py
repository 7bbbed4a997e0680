"""Reading of robot descriptions, URDF or SDF by their ending."""

from __future__ import annotations

from pathlib import Path

import yourdfpy

from lis_grasp.robots.description_edits import DescriptionEdits
from lis_grasp.robots.hand_sdf import parse_sdf
from lis_grasp.robots.hand_urdf import parse_urdf
from lis_grasp.robots.link_tree import HandModel, build_hand_model


def read_description(path: Path, edits: DescriptionEdits | None = None) -> HandModel:
    """Read links, joints, inertias and collision bodies; errors as of `build_hand_model`."""
    return build_hand_model(parse_description(path), path, edits)


def parse_description(path: Path) -> yourdfpy.Robot:
    """Return the links and joints that a description has, unchecked."""
    return parse_sdf(path) if path.suffix == ".sdf" else parse_urdf(path)
