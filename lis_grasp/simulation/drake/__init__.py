"""Simulation in Drake: touching an object, and lifting it."""

from lis_grasp.simulation.drake.dynamic_prober import DynamicProber

__all__ = ["DynamicProber"]
