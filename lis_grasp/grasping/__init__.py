"""Grasping."""
