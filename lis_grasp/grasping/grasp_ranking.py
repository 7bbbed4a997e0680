"""Grasp ranking: quality values of grasp candidates and their predicted success probability."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp.grasping.candidate_filter import GraspCandidates
from lis_grasp.grasping.contact_sets import ContactSets
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.epsilon import epsilon_by_convex_hull, epsilon_by_expanding_polytope
from lis_grasp.grasping.force_closure import resisted_force
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.grip_forces import balanced_grip
from lis_grasp.grasping.surface_uncertainty import UncertainSurface
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray

# Normals are known to a few degrees only: robust qualities use this fraction of the friction.
_ROBUST_FRACTION = 0.5
# Sampled surfaces per estimate; on each of them epsilon may be too small by this fraction.
_SAMPLES = 32
_COARSE = 0.05
# Accelerations are those at this fraction of the friction. A rotation counts as the acceleration at
# this distance from its axis, and radii of gyration below the other one as that [m].
_LOADED_FRACTION = 0.75
_TURN_ARM, _LEAST_GYRATION = 0.1, 0.017
# Torsional lever of a flat pad [m]: 2/3 of a contact radius of 9 mm (Howe and Cutkosky 1996).
_FLAT_PAD_LEVER = 0.006

SUCCESS_MODEL = json.loads(Path(__file__).with_name("success_model.json").read_text("utf-8"))
"""Constants of the logistic success model, and what they were fitted to."""


class GraspScorer:
    """Computes the qualities of grasp candidates, and rejects those not in force closure.

    Each grasp gets, by name:

    - ``epsilon``: `epsilon_quality`; ``epsilon_robust``: the same at half the friction.
    - ``weight_robust``: the weight that it carries at half the friction, `resisted_force`.
    - ``closure_probability``, ``epsilon_expected``: over samples of the true surface given the
      estimate (`UncertainSurface`), the fraction in force closure and the mean of
      ``epsilon_robust``.
    - ``acceleration``: the largest acceleration, linear or angular in any direction, that the hand
      at its largest contact force gives an object of 0.2 kg, `inertial_metric` [m/s^2].
    - ``success_probability``: the predicted probability that the hand lifts and holds the object,
      a logistic function of ``epsilon_expected`` and ``weight_robust``, times another one of
      ``acceleration`` (`SUCCESS_MODEL`). Grasps are ranked by it. The weight is part of it because
      epsilon alone prefers long levers, with which an object turns under its weight about the line
      through the fingers; the acceleration because long objects have more inertia than the friction
      of fingers close together can turn.
    - ``pad_error``: the largest distance of a pad from its contact [m].

    Torques are taken about the centre of mass at uniform density, and divided by the largest
    distance of a vertex from it.

    Rounded pads are hard fingers with Coulomb friction, the flat pads of a parallel-jaw gripper are
    soft fingers. The mesh is closed, in O [m], with a vertex attribute ``"uncertainty"`` [m] where
    it is known.
    """

    def __init__(
        self, hand: Hand, mesh: trimesh.Trimesh, *, friction: float, rng: np.random.Generator
    ) -> None:
        self._hand = hand
        self._model = wrench_model(mesh, hand, friction)
        self._robust = wrench_model(mesh, hand, _ROBUST_FRACTION * friction)
        self._loaded = replace(
            wrench_model(mesh, hand, _LOADED_FRACTION * friction),
            torque_metric=inertial_metric(mesh),
        )
        self._force = 2.0 * hand.max_contact_force / SUCCESS_MODEL["fitted_on"]["mass_kg"]
        self._surface = UncertainSurface.from_mesh(mesh)
        # The same draws for every grasp, whenever its qualities are computed.
        self._seed = rng.integers(2**63)

    def score(self, candidates: GraspCandidates) -> dict[int, Grasp]:
        """Return the grasps in force closure among candidates, by their index."""
        found: dict[int, Grasp] = {}
        for alike, points, normals in candidates.contacts.by_count():
            plain = epsilon_by_expanding_polytope(points, normals, self._model)
            closing = np.flatnonzero(plain > 0.0)
            if not len(closing):
                continue
            robust = np.zeros(len(plain))
            robust[closing] = epsilon_by_expanding_polytope(
                points[closing], normals[closing], self._robust
            )
            loaded = epsilon_by_expanding_polytope(
                points[closing], normals[closing], self._loaded, tolerance=_COARSE
            )
            closure, expected = self._over_surfaces(
                points[closing], normals[closing], robust[closing]
            )
            for k, i in enumerate(closing):
                weight = resisted_force(points[i], normals[i], (0.0, 0.0, 1.0), self._robust)
                b = int(alike[i])
                quality = {
                    "epsilon": plain[i],
                    "epsilon_robust": robust[i],
                    "weight_robust": weight,
                    "closure_probability": closure[k],
                    "epsilon_expected": expected[k],
                    "acceleration": self._force * loaded[k],
                    "success_probability": self._success_probability(
                        expected[k], weight, self._force * loaded[k]
                    ),
                    "pad_error": candidates.postures.position_error[b],
                }
                found[b] = self._grasp(candidates, b, points[i], normals[i], quality)
        return dict(sorted(found.items()))

    def accelerations(self, sets: ContactSets) -> FloatArray:
        """Return ``acceleration`` of B contact sets without postures; shape (B,)."""
        found = np.zeros(len(sets))
        for alike, points, normals in sets.by_count():
            found[alike] = epsilon_by_expanding_polytope(
                points, normals, self._loaded, tolerance=_COARSE
            )
        return self._force * found

    def _over_surfaces(
        self, points: FloatArray, normals: FloatArray, robust: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the probability of closure and the expected robust epsilon, each of shape (B,)."""
        count, contacts = points.shape[:2]
        if not self._surface.deviations.any():
            return np.ones(count), robust
        sampled = self._surface.sample_contacts(
            points, normals, samples=_SAMPLES, rng=np.random.default_rng(self._seed)
        )
        p, n = (a.reshape(-1, contacts, 3) for a in sampled)
        robust = epsilon_by_expanding_polytope(p, n, self._robust, tolerance=_COARSE)
        closes = robust > 0.0  # which implies closure at the whole friction
        rest = np.flatnonzero(~closes)
        if len(rest):
            plain = epsilon_by_expanding_polytope(p[rest], n[rest], self._model, tolerance=_COARSE)
            closes[rest] = plain > 0.0
        by_grasp = (count, _SAMPLES)
        return closes.reshape(by_grasp).mean(axis=1), robust.reshape(by_grasp).mean(axis=1)

    def _success_probability(self, expected: float, weight: float, acceleration: float) -> float:
        logit = SUCCESS_MODEL["intercepts"][self._model.contact_model]
        by_name = {"epsilon_expected": expected, "weight_robust": weight}
        terms = (
            slope * np.log(by_name[name] + SUCCESS_MODEL["offsets"][name])
            for name, slope in SUCCESS_MODEL["slopes"].items()
        )
        load = SUCCESS_MODEL["load"]
        relative = max(acceleration / load["acceleration"], 1e-6)
        carried = 1.0 / (1.0 + relative ** -load["slope"])
        return float(carried / (1.0 + np.exp(-(logit + sum(terms)))))

    def _grasp(
        self,
        candidates: GraspCandidates,
        b: int,
        points: FloatArray,
        normals: FloatArray,
        quality: dict[str, float],
    ) -> Grasp:
        hand, X_OH, friction = self._hand, candidates.postures.X_OH[b], self._model.friction
        used = candidates.contacts.used[b]
        return Grasp(
            hand=hand.name,
            X_OH=X_OH,
            joint_names=hand.joint_names,
            joint_positions=candidates.postures.q[b],
            pregrasp_positions=candidates.opened[b],
            approach_O=X_OH[:3, :3] @ hand.approach_H,
            contact_points=points,
            contact_normals=normals,
            contact_fingers=tuple(f for f, on in zip(hand.fingers, used, strict=True) if on),
            contact_forces=balanced_grip(
                points, normals, friction=friction, total=2.0 * hand.max_contact_force
            ),
            quality=quality,
            accepted=f"force closure at friction {friction:g}, reached, free of collision",
        )


def epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return epsilon of a hand's contacts (C, 3) on an object, defined as in `GraspScorer`."""
    return epsilon_by_convex_hull(points, normals, wrench_model(mesh, hand, friction))


def robust_epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return ``epsilon_robust`` of a hand's contacts (C, 3) on an object.

    It predicts a lift from measured contacts: of 186 lifts, planned on 5 to 15 touches, 137 of the
    147 with more than zero of it held, and 10 of the 39 others.
    """
    return epsilon_on(mesh, hand, points, normals, friction=_ROBUST_FRACTION * friction)


def wrench_model(mesh: trimesh.Trimesh, hand: Hand, friction: float) -> WrenchModel:
    """Return the wrench model of a hand's contacts on an object; see `GraspScorer`."""
    center = np.asarray(mesh.center_mass)
    length = float(np.linalg.norm(mesh.vertices - center, axis=1).max())
    model = WrenchModel(friction, origin=center, length_scale=length)
    if hand.kind == "jaw":
        model = replace(model, contact_model="soft_finger", torsion=friction * _FLAT_PAD_LEVER)
    return model


def inertial_metric(mesh: trimesh.Trimesh) -> FloatArray:
    """Return the matrix (3, 3) [1/m] that makes accelerations of wrenches, of unit mass.

    A wrench accelerates an object of uniform density and mass m by ``f / m`` and turns it by
    ``I^-1 tau``. The latter counts as the acceleration at 0.1 m from the axis, so the epsilon in
    this metric is a largest acceleration of the unit mass, per unit of the fingers' forces.
    """
    by_mass, axes = np.linalg.eigh(np.asarray(mesh.moment_inertia) / mesh.volume)  # [m^2]
    inverse = 1.0 / np.maximum(by_mass, _LEAST_GYRATION**2)
    return np.asarray(_TURN_ARM * (axes * inverse) @ axes.T)
