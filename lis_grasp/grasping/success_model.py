"""Predicted success of a grasp: logistic functions of its qualities, fitted to simulated lifts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.typing import FloatArray

SUCCESS_MODEL = json.loads(Path(__file__).with_name("success_model.json").read_text("utf-8"))
"""Constants of the model, and what they were fitted to."""

LEAST_ACCELERATION = 0.02
"""A smaller acceleration counts as this one [m/s^2]."""


def load_probability(acceleration: npt.ArrayLike, model: WrenchModel) -> FloatArray:
    """Return the predicted probability that a grasp of some ``acceleration`` carries its load.

    It is a logistic function of the logarithm. The success probability is its product with
    `shape_probability`.
    """
    load = SUCCESS_MODEL["load"][model.contact_model]
    relative = np.maximum(acceleration, LEAST_ACCELERATION) / load["acceleration"]
    return np.asarray(1.0 / (1.0 + relative ** -load["slope"]))


def shape_probability(epsilon_expected: npt.ArrayLike, model: WrenchModel) -> FloatArray:
    """Return the predicted probability that a grasp holds an object of hardly any weight.

    It depends on the surface and what is known of it: the qualities ``epsilon_expected``.
    """
    slope, offset = (SUCCESS_MODEL[name]["epsilon_expected"] for name in ("slopes", "offsets"))
    logit = SUCCESS_MODEL["intercepts"][model.contact_model]
    logit = logit + slope * np.log(np.asarray(epsilon_expected) + offset)
    return np.asarray(1.0 / (1.0 + np.exp(-logit)))
