"""Layer of the object's motion under touch: its tracked and its true path."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from lis_grasp.exploration.probe import since_loss
from lis_grasp.typing import FloatArray
from lis_grasp.visualization import drawing
from lis_grasp.visualization.drawing import ROOT, Canvas, Layer

if TYPE_CHECKING:
    from lis_grasp.exploration import ProbeOutcome

TRACKED_COLOUR, TRUE_COLOUR = "#c2571a", "#4a4a4a"
_TRACKED_RADIUS, _TRUE_RADIUS = 0.0009, 0.0006  # [m]
# Motions below this are not drawn [m].
_LEAST = 1e-5


def motion_paths(
    outcomes: Sequence[ProbeOutcome], center: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the tracked and the true path of a point of the object, each (K, 3) [m].

    They are in the frame of the contacts after the last outcome, where the object's frame is at its
    final pose; outcomes before a loss of the object are left out.

    Parameters
    ----------
    outcomes
        Of an exploration with a tracked pose.
    center
        Shape (3,): the point, in that frame [m].
    """
    known = [
        o for o in since_loss(outcomes) if o.tracked is not None and o.simulated_pose is not None
    ]
    if not known:
        return np.empty((0, 3)), np.empty((0, 3))
    frames = np.array([outcome.tracked.X_WE for outcome in known if outcome.tracked])  # (K, 4, 4)
    poses = np.array([outcome.simulated_pose for outcome in known])  # (K, 4, 4)
    to_last = np.linalg.inv(frames[-1]) @ frames
    at_center = np.append(center, 1.0)
    in_object = np.linalg.inv(poses[-1]) @ at_center
    return (to_last @ at_center)[:, :3], (to_last @ poses @ in_object)[:, :3]


def draw_pose_track(canvas: Canvas, outcomes: Sequence[ProbeOutcome], center: FloatArray) -> None:
    """Draw the tracked and the true path of a point (3,) that touches moved, if they did."""
    tracked, true = motion_paths(outcomes, center)
    reach = max(
        (float(np.ptp(path, axis=0).max()) for path in (tracked, true) if len(path)), default=0.0
    )
    if reach < _LEAST:
        return
    for name, path, radius, colour in (
        ("tracked", tracked, _TRACKED_RADIUS, TRACKED_COLOUR),
        ("true", true, _TRUE_RADIUS, TRUE_COLOUR),
    ):
        mesh = _line(path, radius)
        material = drawing.material(colour, roughness=0.7)
        canvas.commands.append(drawing.draw_mesh(f"{ROOT}/motion/{name}", mesh, material))
    moved = 1e3 * float(np.linalg.norm(true - true[0], axis=1).max())
    off = 1e3 * float(np.linalg.norm(tracked - true, axis=1).max())
    note = (
        f"of the object's middle under touch, by up to {moved:.1f} mm (grey); tracked to within"
        f" {off:.1f} mm"
    )
    canvas.layers.append(Layer("motion", "Motion", True, TRACKED_COLOUR, note))


def _line(path: FloatArray, radius: float) -> trimesh.Trimesh:
    """Return a tube along a path (K, 3), with a ball at its end."""
    ball = trimesh.creation.icosphere(2, 3.0 * radius).apply_translation(path[-1])
    steps = [(a, b) for a, b in pairwise(path) if np.linalg.norm(b - a) > _LEAST]
    tubes = [trimesh.creation.cylinder(radius, segment=step, sections=8) for step in steps]
    return trimesh.util.concatenate([ball, *tubes])
