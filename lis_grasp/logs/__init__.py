"""Robots' logs and tactile patches: the touches in them, and their contacts."""

from lis_grasp.exploration.touch_detection import TouchDetection
from lis_grasp.logs.contacts import Finger, LogFrames, contacts_from_log
from lis_grasp.logs.patches import PatchDetection, TactilePatches, contacts_from_patches
from lis_grasp.logs.readers import open_log
from lis_grasp.logs.reading import LogReading

__all__ = [
    "Finger",
    "LogFrames",
    "LogReading",
    "PatchDetection",
    "TactilePatches",
    "TouchDetection",
    "contacts_from_log",
    "contacts_from_patches",
    "open_log",
]
