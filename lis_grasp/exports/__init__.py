"""Exports of objects and grasps to other programs."""
