"""Grasping: hands, contact models, quality, collision, and the sampler of grasps; no Drake."""
