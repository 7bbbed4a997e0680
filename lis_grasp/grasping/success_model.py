"""Predicted success of a grasp: logistic functions of its qualities, fitted to simulated lifts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lis_grasp.grasping.contact_wrenches import WrenchModel

SUCCESS_MODEL = json.loads(Path(__file__).with_name("success_model.json").read_text("utf-8"))
"""Constants of the model, and what they were fitted to."""


def success_probability(quality: Mapping[str, float], model: WrenchModel) -> float:
    """Return the predicted probability that a grasp lifts and holds the object.

    It is `shape_probability` times a logistic function of the quality ``acceleration`` and of the
    friction of `model`.
    """
    load = SUCCESS_MODEL["load"]
    enough = load["accelerations"][model.contact_model]
    enough *= (model.friction / load["friction"]) ** load["friction_exponent"]
    relative = max(quality["acceleration"] / enough, 1e-6)
    carried = 1.0 / (1.0 + relative ** -load["slope"])
    return float(carried * shape_probability(quality, model))


def shape_probability(quality: Mapping[str, float], model: WrenchModel) -> float:
    """Return the predicted probability that a grasp holds an object of hardly any weight.

    It depends on the surface and what is known of it: the quality ``epsilon_expected``.
    """
    logit = SUCCESS_MODEL["intercepts"][model.contact_model]
    for name, slope in SUCCESS_MODEL["slopes"].items():
        logit += slope * np.log(quality[name] + SUCCESS_MODEL["offsets"][name])
    return float(1.0 / (1.0 + np.exp(-logit)))
