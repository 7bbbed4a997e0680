"""Grasping: contact models, quality, and the sampler of grasps; no Drake."""

from lis_grasp.grasping.contact_wrenches import WrenchModel

__all__ = ["WrenchModel"]
