"""Simulation in Drake: touching an object, and lifting it."""

from lis_grasp.simulation.dynamic_prober import DynamicProber

__all__ = ["DynamicProber"]
