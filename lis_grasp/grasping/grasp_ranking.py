"""Grasp ranking: quality values of grasp candidates and their predicted success probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import trimesh

from lis_grasp.grasping.candidate_filter import GraspCandidates
from lis_grasp.grasping.contact_sets import ContactSets
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.epsilon import epsilon_by_convex_hull, epsilon_by_expanding_polytope
from lis_grasp.grasping.force_closure import resisted_forces
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.grip_capacity import grip_fraction
from lis_grasp.grasping.grip_forces import balanced_grip
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.grasping.success_model import shape_probability, success_probability
from lis_grasp.grasping.surface_uncertainty import UncertainSurface
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray

# Normals are known to a few degrees only: robust qualities use this fraction of the friction.
_ROBUST_FRACTION = 0.5
# On sampled surfaces, epsilon may be too small by this fraction.
_COARSE = 0.05
# Loads are carried at this fraction of the friction. A rotation counts as the acceleration at the
# first distance [m] from its axis, as in a lift's shake; radii of gyration are at least the second.
_LOADED_FRACTION = 0.75
_TURN_ARM, _LEAST_GYRATION = 0.65, 0.017
# Torsional lever of a flat pad [m]: 2/3 of a contact radius of 9 mm (Howe and Cutkosky 1996).
_FLAT_PAD_LEVER = 0.006


class _Precision(NamedTuple):
    """Precision of qualities: sampled surfaces, and by what fraction epsilon may be too small."""

    surfaces: int
    tolerance: float


# Most candidates are only ranked; what is reported is precise.
_RANKED, _REPORTED = _Precision(4, _COARSE), _Precision(32, 1e-6)


class GraspScorer:
    """Computes the qualities of grasp candidates, and rejects those not in force closure.

    Each grasp gets, by name:

    - ``epsilon``: `epsilon_quality`; ``epsilon_robust``: the same at half the friction.
    - ``weight_robust``: the weight that it carries at half the friction, `resisted_force`.
    - ``closure_probability``, ``epsilon_expected``: over samples of the true surface given the
      estimate (`UncertainSurface`), the fraction in force closure and the mean of
      ``epsilon_robust``.
    - ``grip``: the sum of the largest normal forces in balance that the hand exerts in this
      posture, within its joint efforts and its largest contact force [N].
    - ``load_per_grip``: the largest load, in any direction, that contacts carry per unit of grip,
      and ``acceleration``: the largest acceleration, linear or angular, that the grip gives the
      object [m/s^2]; both in the metric of `inertial_metric`.
    - ``success_probability``: the predicted probability that the hand lifts and holds the object,
      a logistic function of ``epsilon_expected``, times another one of ``acceleration``
      (`success_model`). The acceleration is part of it because heavy
      objects have more weight, and long ones more inertia, than the friction of fingers close
      together can carry.
    - ``shape_probability``: the first of these two factors, which knowing the surface raises.
    - ``clearance``: the distance of the links that are no fingertips from the surface [m].
    - ``pad_error``: the largest distance of a pad from its contact [m].

    `score` computes them roughly, for ranking, at the median mass and friction of the prior:
    epsilon may be too small by 5 %, four surfaces are sampled, and ``weight_robust``, which does
    not count, is left out. `predict_success` computes them precisely, and averages the success
    probability over both distributions.

    Torques are taken about the centre of mass at uniform density, and divided by the largest
    distance of a vertex from it.

    Rounded pads are hard fingers with Coulomb friction, the flat pads of a parallel-jaw gripper are
    soft fingers. The mesh is closed, in O [m], with a vertex attribute ``"uncertainty"`` [m] where
    it is known.
    """

    def __init__(
        self, hand: Hand, mesh: trimesh.Trimesh, *, prior: LoadPrior, rng: np.random.Generator
    ) -> None:
        self._hand, self._prior = hand, prior
        self._models = [
            (_FrictionModels.of(mesh, hand, friction), weight)
            for friction, weight in prior.frictions()
        ]
        self._median = self._models[0][0]
        self._surface = UncertainSurface.from_mesh(mesh)
        # The same draws for every grasp, whenever its qualities are computed.
        self._seed = rng.integers(2**63)

    def score(self, candidates: GraspCandidates) -> dict[int, Grasp]:
        """Return the grasps in force closure among candidates, by their index; see the class."""
        found: dict[int, Grasp] = {}
        postures, mass = candidates.postures, self._prior.mass
        for alike, points, normals in candidates.contacts.by_count():
            plain = epsilon_by_expanding_polytope(
                points, normals, self._median.plain, tolerance=_RANKED.tolerance
            )
            closing = np.flatnonzero(plain > 0.0)
            if not len(closing):
                continue
            qualities = self._qualities(points[closing], normals[closing], self._median, _RANKED)
            for k, i in enumerate(closing):
                b = int(alike[i])
                used = candidates.contacts.used[b]
                fingers = tuple(f for f, on in zip(self._hand.fingers, used, strict=True) if on)
                forces = balanced_grip(
                    points[i],
                    normals[i],
                    friction=self._prior.friction,
                    total=2.0 * self._hand.max_contact_force,
                )
                X_OH, q = postures.X_OH[b], postures.q[b]
                forces = grip_fraction(self._hand, X_OH, q, fingers, forces) * forces
                quality = {"epsilon": float(plain[i]), **qualities[k]}
                quality["grip"] = -float(np.sum(forces * normals[i]))
                quality["acceleration"] = quality["grip"] * quality["load_per_grip"] / mass
                quality["shape_probability"] = shape_probability(quality, self._median.plain)
                quality["success_probability"] = success_probability(quality, self._median.plain)
                quality["clearance"] = float(candidates.clearance[b])
                quality["pad_error"] = float(postures.position_error[b])
                found[b] = Grasp(
                    hand=self._hand.name,
                    X_OH=X_OH,
                    joint_names=self._hand.joint_names,
                    joint_positions=q,
                    pregrasp_positions=candidates.opened[b],
                    approach_O=X_OH[:3, :3] @ self._hand.approach_H,
                    contact_points=points[i],
                    contact_normals=normals[i],
                    contact_fingers=fingers,
                    contact_forces=forces,
                    quality=quality,
                    accepted=f"force closure at friction {self._prior.friction:g}, reached, free of"
                    " collision",
                )
        return dict(sorted(found.items()))

    def predict_success(self, grasps: Sequence[Grasp]) -> list[Grasp]:
        """Return grasps with precise qualities and the success probability over the whole prior.

        Qualities other than the success probability are those at the medians.
        """
        counts = np.array([len(grasp.contact_points) for grasp in grasps])
        predicted = list(grasps)
        for count in np.unique(counts):
            alike = np.flatnonzero(counts == count).tolist()
            points = np.array([grasps[i].contact_points for i in alike])
            normals = np.array([grasps[i].contact_normals for i in alike])
            plain = epsilon_by_expanding_polytope(
                points, normals, self._median.plain, tolerance=_REPORTED.tolerance
            )
            weights = resisted_forces(points, normals, (0.0, 0.0, 1.0), self._median.robust)
            medians = self._qualities(points, normals, self._median, _REPORTED)
            by_friction = [medians] + [
                self._qualities(points, normals, models, _RANKED) for models, _ in self._models[1:]
            ]
            for k, i in enumerate(alike):
                quality = {**grasps[i].quality, "epsilon": float(plain[k]), **medians[k]}
                quality["weight_robust"] = float(weights[k])
                success = 0.0
                for qualities, (models, of_friction) in zip(by_friction, self._models, strict=True):
                    load = quality["grip"] * qualities[k]["load_per_grip"]
                    for mass, of_mass in self._prior.masses():
                        at_load = {**qualities[k], "acceleration": load / mass}
                        success += (
                            of_friction * of_mass * success_probability(at_load, models.plain)
                        )
                load = quality["grip"] * quality["load_per_grip"]
                quality["acceleration"] = load / self._prior.mass
                quality["shape_probability"] = shape_probability(quality, self._median.plain)
                quality["success_probability"] = success
                predicted[i] = replace(grasps[i], quality=quality)
        return predicted

    def accelerations(self, sets: ContactSets) -> FloatArray:
        """Return ``acceleration`` of B contact sets per unit of grip and mass; shape (B,)."""
        found = np.zeros(len(sets))
        for alike, points, normals in sets.by_count():
            found[alike] = epsilon_by_expanding_polytope(
                points, normals, self._median.loaded, tolerance=_COARSE
            )
        return found

    def _qualities(
        self,
        points: FloatArray,
        normals: FloatArray,
        models: _FrictionModels,
        precision: _Precision,
    ) -> list[dict[str, float]]:
        """Return the qualities of each grasp's contacts, (B, C, 3), that depend on the friction."""
        tolerance = precision.tolerance
        robust = epsilon_by_expanding_polytope(points, normals, models.robust, tolerance=tolerance)
        closure, expected = self._over_surfaces(points, normals, robust, models, precision.surfaces)
        values = {
            "epsilon_robust": robust,
            "closure_probability": closure,
            "epsilon_expected": expected,
            "load_per_grip": epsilon_by_expanding_polytope(
                points, normals, models.loaded, tolerance=tolerance
            ),
        }
        return [
            {name: float(value[b]) for name, value in values.items()} for b in range(len(points))
        ]

    def _over_surfaces(
        self,
        points: FloatArray,
        normals: FloatArray,
        robust: FloatArray,
        models: _FrictionModels,
        samples: int,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the probability of closure and the expected robust epsilon, each of shape (B,)."""
        count, contacts = points.shape[:2]
        if not self._surface.deviations.any():
            return np.ones(count), robust
        sampled = self._surface.sample_contacts(
            points, normals, samples=samples, rng=np.random.default_rng(self._seed)
        )
        p, n = (a.reshape(-1, contacts, 3) for a in sampled)
        robust = epsilon_by_expanding_polytope(p, n, models.robust, tolerance=_COARSE)
        closes = robust > 0.0  # which implies closure at the whole friction
        rest = np.flatnonzero(~closes)
        if len(rest):
            plain = epsilon_by_expanding_polytope(p[rest], n[rest], models.plain, tolerance=_COARSE)
            closes[rest] = plain > 0.0
        by_grasp = (count, samples)
        return closes.reshape(by_grasp).mean(axis=1), robust.reshape(by_grasp).mean(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _FrictionModels:
    """Wrench models at one friction: of closure, of robust qualities, and of accelerations."""

    plain: WrenchModel
    robust: WrenchModel
    loaded: WrenchModel

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, hand: Hand, friction: float) -> _FrictionModels:
        """Return the models of a hand's contacts on a mesh."""
        return cls(
            wrench_model(mesh, hand, friction),
            wrench_model(mesh, hand, _ROBUST_FRACTION * friction),
            replace(
                wrench_model(mesh, hand, _LOADED_FRACTION * friction),
                torque_metric=inertial_metric(mesh),
            ),
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
    ``I^-1 tau``. The latter counts as the acceleration at 0.65 m from the axis, so the epsilon in
    this metric is a largest acceleration of the unit mass, per unit of the fingers' forces.
    """
    by_mass, axes = np.linalg.eigh(np.asarray(mesh.moment_inertia) / mesh.volume)  # [m^2]
    inverse = 1.0 / np.maximum(by_mass, _LEAST_GYRATION**2)
    return np.asarray(_TURN_ARM * (axes * inverse) @ axes.T)
