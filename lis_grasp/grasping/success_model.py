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


def load_probability(
    acceleration: npt.ArrayLike, mass: npt.ArrayLike, model: WrenchModel
) -> FloatArray:
    """Return the predicted probability that grasps of some ``acceleration`` carry a mass [kg].

    It is a logistic function of two logarithms: of ``acceleration``, plus an offset, because true
    contacts may carry what those on an estimate do not; and of the mass, because fingers yield
    under a load. The shapes of both arguments are broadcast. The success probability is the product
    with `shape_probability`.
    """
    load, offset = SUCCESS_MODEL["load"][model.contact_model], SUCCESS_MODEL["offsets"]
    spare = (np.asarray(acceleration) + offset["acceleration"]) / load["acceleration"]
    burden = np.asarray(mass) / SUCCESS_MODEL["mass"]["usual"]
    odds = spare ** load["slope"] / burden ** SUCCESS_MODEL["mass"]["slope"]
    return np.asarray(odds / (1.0 + odds))


def shape_probability(epsilon_expected: npt.ArrayLike, model: WrenchModel) -> FloatArray:
    """Return the predicted probability that a grasp holds an object of hardly any weight.

    It depends on the surface and what is known of it: the qualities ``epsilon_expected``.
    """
    slope, offset = (SUCCESS_MODEL[name]["epsilon_expected"] for name in ("slopes", "offsets"))
    logit = SUCCESS_MODEL["intercepts"][model.contact_model]
    logit = logit + slope * np.log(np.asarray(epsilon_expected) + offset)
    return np.asarray(1.0 / (1.0 + np.exp(-logit)))
