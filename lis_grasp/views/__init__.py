"""Views of depth cameras: contacts, what the contour implies, free space, calibration."""

from lis_grasp.views.camera import HandEye, Intrinsics, draw_camera_pose, look_at
from lis_grasp.views.depth_noise import DepthNoise
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.hand_eye import Calibration
from lis_grasp.views.object_mask import segment_object
from lis_grasp.views.rendering import render_depth
from lis_grasp.views.simulated_view import DepthCamera, simulate_view
from lis_grasp.views.view_files import load_view, save_view
from lis_grasp.views.views import FreeViews, Views

__all__ = [
    "Calibration",
    "DepthCamera",
    "DepthNoise",
    "DepthView",
    "FreeViews",
    "HandEye",
    "Intrinsics",
    "Views",
    "draw_camera_pose",
    "load_view",
    "look_at",
    "render_depth",
    "save_view",
    "segment_object",
    "simulate_view",
]
__dir__ = sorted(__all__).copy  # dir() lists the public names
