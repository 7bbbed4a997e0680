"""Depth viewer: a Drake system from a depth image and a camera's pose to a view of an object."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.perception import PointCloud
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageLabel16I

from lis_grasp.drake._ports import declare_output, read_port
from lis_grasp.exceptions import InvalidViewError
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views import DepthNoise, DepthView, HandEye, Intrinsics, segment_object
from lis_grasp.views.organised_clouds import depth_of_points

# Pixel centres of Drake's RgbdSensor.
_PIXEL_CENTER = 0.5


class DepthViewer(LeafSystem):
    """Makes a view of an object from the depth image of an `RgbdSensor`.

    .. code-block:: text

        depth_image or point_cloud, camera_pose [, label_image] -> DepthViewer -> view

    ``depth_image`` is an `ImageDepth32F`, or ``point_cloud`` the `PointCloud` that a
    `DepthImageToPointCloud` makes of it without a ``camera_pose``. ``camera_pose`` is a
    `RigidTransform`: the sensor's ports ``depth_image_32f`` and ``body_pose_in_world``. ``view`` is
    a `DepthView` with the object's pixels: those with the label `label`, if the port
    ``label_image`` is connected, else those above the table. The principal point moves by half a
    pixel: a view has its pixel centres at 0.

    Parameters
    ----------
    camera_info
        Intrinsics of the depth camera.
    support_height
        Height of the table in the world [m].
    X_BC
        Pose of the depth camera in the sensor's body.
    label
        The object's label in ``label_image``.
    noise
        Of the depth; None for an exact one, as Drake renders it.
    hand_eye
        Prior of the error of ``camera_pose``; None for an exact one.

    Examples
    --------
    >>> viewer = DepthViewer(CameraInfo(width=640, height=480, fov_y=0.8))
    >>> [viewer.get_input_port(k).get_name() for k in range(viewer.num_input_ports())]
    ['depth_image', 'camera_pose', 'label_image', 'point_cloud']
    """

    def __init__(
        self,
        camera_info: CameraInfo,
        *,
        support_height: float = 0.0,
        X_BC: RigidTransform | None = None,
        label: int | None = None,
        noise: DepthNoise | None = None,
        hand_eye: HandEye | None = None,
    ) -> None:
        super().__init__()
        self._intrinsics = Intrinsics(
            camera_info.focal_x(),
            camera_info.focal_y(),
            camera_info.center_x() - _PIXEL_CENTER,
            camera_info.center_y() - _PIXEL_CENTER,
        )
        self._shape = camera_info.height(), camera_info.width()
        self._support_height, self._label = support_height, label
        self._X_BC = np.eye(4) if X_BC is None else X_BC.GetAsMatrix4()
        self._noise = DepthNoise.none() if noise is None else noise
        self._hand_eye = HandEye(0.0, 0.0) if hand_eye is None else hand_eye
        declare = self.DeclareAbstractInputPort
        self.depth_image = declare("depth_image", AbstractValue.Make(ImageDepth32F()))
        self.camera_pose = declare("camera_pose", AbstractValue.Make(RigidTransform()))
        self.label_image = declare("label_image", AbstractValue.Make(ImageLabel16I()))
        self.point_cloud = declare("point_cloud", AbstractValue.Make(PointCloud()))
        nothing = DepthView(np.full((3, 3), np.nan), self._intrinsics, np.eye(4))
        self.view = declare_output(
            self, "view", nothing, self._calculate, {self.all_input_ports_ticket()}
        )

    def _calculate(self, context: Context) -> DepthView:
        pose = read_port(self.camera_pose, context, RigidTransform, "an RgbdSensor's pose")
        view = DepthView(
            self._depth(context),
            self._intrinsics,
            pose.GetAsMatrix4() @ self._X_BC,
            noise=self._noise,
            hand_eye=self._hand_eye,
        )
        if not self.label_image.HasValue(context):
            return segment_object(view, self._support_height)
        labels = read_port(self.label_image, context, ImageLabel16I, "an RgbdSensor's label image")
        return view.with_mask(self._labelled(labels))

    def _depth(self, context: Context) -> FloatArray:
        """Return the depth of each pixel, (H, W) [m]."""
        if not self.point_cloud.HasValue(context):
            made = "an RgbdSensor's depth image"
            image = read_port(self.depth_image, context, ImageDepth32F, made)
            return np.asarray(image.data[..., 0], dtype=np.float64)
        made = "the cloud of a DepthImageToPointCloud"
        points = read_port(self.point_cloud, context, PointCloud, made).xyzs().T
        if len(points) != np.prod(self._shape):
            raise InvalidViewError(
                f"point_cloud must have a point for each of {self._shape[1]} x {self._shape[0]}"
                f" pixels; it has {len(points)}: connect it before points are removed",
                field="points",
            )
        return depth_of_points(points.reshape(*self._shape, 3))[0]

    def _labelled(self, labels: Any) -> BoolArray:
        if self._label is None:
            raise InvalidViewError(
                "label_image is connected: give the object's label, `label`, such as"
                " int(plant.GetBodyIndices(model)[0])",
                field="mask",
            )
        return np.asarray(labels.data[..., 0] == self._label)
