"""Conditions of a run: what is known of the object, its pose, and the tactile sensor."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.exploration import DEFAULT_REGION
from lis_grasp.shapes import STABLE

IDEAL_SENSOR: Mapping[str, float] = MappingProxyType(
    {"position_noise": 0.0, "normal_noise": 0.0, "force_threshold": 0.0, "taxel_pitch": 0.0}
)
"""A sensor without noise."""

REAL_SENSOR: Mapping[str, float] = MappingProxyType(
    {
        "position_noise": 0.0005,
        "normal_noise": float(np.radians(3.0)),
        "force_threshold": 0.05,
        "taxel_pitch": 0.002,
    }
)
"""A sensor like a real one: 0.5 mm, 3 deg, 0.05 N, taxels 2 mm apart."""

KNOWN: Mapping[str, Any] = MappingProxyType(
    {"pose": None, "region": None, "free": False, "load": "known", **IDEAL_SENSOR}
)
"""Place, size, mass and friction are known, the object is fixed at the pose of its mesh, and the
sensor is ideal."""

UNKNOWN: Mapping[str, Any] = MappingProxyType(
    {
        "pose": STABLE,
        "region": list(DEFAULT_REGION),
        "free": True,
        "load": "unknown",
        **REAL_SENSOR,
    }
)
"""Only a region is known, not even mass and friction; the object is free, in a stable pose; the
sensor is realistic."""

CONDITIONS: Mapping[str, Mapping[str, Any]] = MappingProxyType({"known": KNOWN, "unknown": UNKNOWN})
"""Both by name."""
