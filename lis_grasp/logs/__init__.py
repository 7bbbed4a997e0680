"""Robots' logs: forces and poses over time, the touches in them, and their contacts."""

from lis_grasp.logs.log_touches import Finger, LogFrames, contacts_from_log
from lis_grasp.logs.robot_logs import open_log
from lis_grasp.logs.touch_detection import TouchDetection

__all__ = ["Finger", "LogFrames", "TouchDetection", "contacts_from_log", "open_log"]
