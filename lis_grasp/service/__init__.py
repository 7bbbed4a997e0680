"""Requests of a robot's program: the next touch, the estimate and grasps."""
