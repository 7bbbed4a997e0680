"""Simulated depth views of meshes on a table, with a camera's noise and its pose's error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import trimesh

from lis_grasp.geometry import inverse_pose
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray
from lis_grasp.views.camera import HandEye, Intrinsics
from lis_grasp.views.depth_noise import DepthNoise
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.rendering import plane_depth, render_depth


@dataclass(frozen=True, slots=True)
class DepthCamera(Record):
    """A depth camera: its intrinsics, image (rows, columns), range, noise, and error of its pose.

    The default is near to a RealSense D435 of 640 x 480 pixels, with an exact pose.
    """

    intrinsics: Intrinsics = field(default_factory=lambda: Intrinsics(385.0, 385.0, 319.5, 239.5))
    shape: tuple[int, int] = (480, 640)
    noise: DepthNoise = field(default_factory=DepthNoise)
    hand_eye: HandEye = field(default_factory=lambda: HandEye(0.0, 0.0))
    farthest: float = 4.0  #: depth beyond which it is unlimited [m]


def simulate_view(
    meshes: Sequence[trimesh.Trimesh],
    X_WC: FloatArray,
    camera: DepthCamera | None = None,
    *,
    rng: np.random.Generator,
    support_height: float | None = 0.0,
    is_transparent: bool = False,
) -> DepthView:
    """Return what a camera sees of an object, with its true mask.

    Parameters
    ----------
    meshes
        The object first, then other bodies, in W [m].
    X_WC
        True pose (4, 4) of the camera. That of the view has the camera's error.
    camera
        None for a default one.
    support_height
        Height of the table in W [m]; None for no table.
    is_transparent
        Whether the object is a hole in the depth image.
    """
    camera = camera or DepthCamera()
    true, label = render_depth(meshes, camera.intrinsics, camera.shape, X_WC)
    if support_height is not None:
        table = plane_depth(camera.intrinsics, camera.shape, X_WC, support_height)
        label = np.where(table < true, -1, label)
        true = np.minimum(true, table)
    true[true > camera.farthest] = np.inf
    depth = camera.noise.measured(true, camera.intrinsics.fx, rng=rng)
    mask = label == 0
    if is_transparent:
        depth = np.where(mask, np.nan, depth)
    error = camera.hand_eye.draw(rng=rng)
    return DepthView(
        depth, camera.intrinsics, X_WC @ inverse_pose(error), mask, camera.noise, camera.hand_eye
    )
