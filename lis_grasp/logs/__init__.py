"""Robots' logs: forces and poses over time, the touches in them, and their contacts."""

from lis_grasp.logs.contacts import Finger, LogFrames, contacts_from_log
from lis_grasp.logs.detection import TouchDetection
from lis_grasp.logs.readers import open_log

__all__ = ["Finger", "LogFrames", "TouchDetection", "contacts_from_log", "open_log"]
