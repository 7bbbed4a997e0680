"""Simulators of touches and lifts, one folder each: Drake, and MuJoCo for lifts."""

from typing import Any


def __getattr__(name: str) -> Any:
    """Load `DynamicProber` on first use, so that MuJoCo does without Drake (PEP 562)."""
    if name == "DynamicProber":
        from lis_grasp.simulation.drake.dynamic_prober import DynamicProber

        return DynamicProber
    raise AttributeError(f"module 'lis_grasp.simulation' has no attribute '{name}'")


__all__ = ["DynamicProber"]
