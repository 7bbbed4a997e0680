"""Grasp ranking: quality values of grasp candidates and their predicted success probability."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import trimesh

from lis_grasp.geometry import rotate
from lis_grasp.grasping.candidate_filter import GraspCandidates
from lis_grasp.grasping.contact_sets import ContactSets, contacts_of, fill_unused
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.epsilon import (
    epsilon_by_convex_hull,
    epsilon_by_expanding_polytope,
    epsilon_of_wrenches,
)
from lis_grasp.grasping.force_closure import resisted_forces
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.grip_capacity import grip_fraction
from lis_grasp.grasping.grip_forces import balanced_grip
from lis_grasp.grasping.load_capacity import largest_wrenches, spare_accelerations
from lis_grasp.grasping.load_prior import LoadPrior
from lis_grasp.grasping.success_model import load_probability, shape_probability
from lis_grasp.grasping.surface_uncertainty import UncertainSurface
from lis_grasp.records import subset_of
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

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
    """Precision of qualities: sampled surfaces, and by what fraction values may be too small."""

    surfaces: int
    epsilon: float
    acceleration: float


# Most candidates are only ranked; what is reported is precise.
_RANKED, _REPORTED = _Precision(4, _COARSE, 0.01), _Precision(32, 1e-6, 1e-4)


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
    - ``load_per_grip``: the largest load, in any direction, that contacts carry per unit of grip.
    - ``acceleration``: the largest acceleration, linear or angular in any direction, that the
      fingers can add to holding the weight, within their joint efforts (`spare_accelerations`)
      [m/s^2]. Both are in the metric of `inertial_metric`.
    - ``success_probability``: the predicted probability that the hand lifts and holds the object,
      a logistic function of ``epsilon_expected``, times another one of ``acceleration`` and mass
      (`success_model`). The acceleration is part of it because heavy objects have more weight,
      and long ones more inertia, than the motors or the friction of fingers close together carry.
    - ``shape_probability``: the first of these two factors, which knowing the surface raises.
    - ``clearance``: the distance of the links that are no fingertips from the surface [m].
    - ``pad_error``: the largest distance of a pad from its contact [m].

    `score` computes those that ranking depends on, at the median friction of the prior and roughly:
    epsilon may be too small by 5 %, and four surfaces are sampled. Its ``epsilon`` is only a lower
    bound, above zero. `predict_success` computes all but ``grip`` precisely, and averages the
    success probability over the distributions of mass and friction. `plan_forces` adds ``grip``.

    Torques are taken about the centre of mass at uniform density, and divided by the largest
    distance of a vertex from it.

    Rounded pads are hard fingers with Coulomb friction, the flat pads of a parallel-jaw gripper are
    soft fingers. The mesh is closed, in O [m], with a vertex attribute ``"uncertainty"`` [m] where
    it is known. `rejected` counts candidates that `score` rejected by reason: ``no_force_closure``,
    and ``outranked``.
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
        self.rejected: Counter[str] = Counter()

    def score(
        self, candidates: GraspCandidates, least_success: FloatArray | None = None
    ) -> dict[int, Grasp]:
        """Return the grasps in force closure among candidates, by their index; see the class.

        With `least_success` (B,), those of a smaller success probability may be rejected. Contact
        forces are zero until `plan_forces`.
        """
        batch, median = _Batch.of_candidates(candidates), self._median
        (robust,) = self._epsilons(batch, (median.robust,), _RANKED.epsilon)
        plain, rest = robust.copy(), np.flatnonzero(robust == 0.0)
        (plain[rest],) = self._epsilons(batch.subset(rest), (median.plain,), _RANKED.epsilon)
        kept = np.flatnonzero(plain > 0.0)
        self.rejected["no_force_closure"] += len(batch) - len(kept)
        accelerations, carried = self._carry(batch.subset(kept), median, _RANKED.acceleration)
        if least_success is not None:
            likely = carried >= least_success[kept]  # of which the success probability is a part
            self.rejected["outranked"] += len(kept) - int(likely.sum())
            kept, accelerations, carried = kept[likely], accelerations[likely], carried[likely]
        batch, robust = batch.subset(kept), robust[kept]
        expected, _ = self._over_surfaces(batch, robust, _RANKED.surfaces)
        shape = shape_probability(expected, median.plain)
        values = {
            "epsilon": plain[kept],
            "epsilon_robust": robust,
            "epsilon_expected": expected,
            "acceleration": accelerations,
            "shape_probability": shape,
            "success_probability": shape * carried,
            "clearance": candidates.clearance[kept],
            "pad_error": candidates.postures.position_error[kept],
        }
        return {
            b: self._grasp(batch, k, candidates.opened[b], _each(values, k))
            for k, b in enumerate(kept.tolist())
        }

    def _grasp(self, batch: _Batch, k: int, opened: FloatArray, quality: dict[str, float]) -> Grasp:
        """Return a grasp of a batch, without contact forces."""
        X_OH, pads = batch.X_OH[k], np.flatnonzero(batch.used[k])
        return Grasp(
            hand=self._hand.name,
            X_OH=X_OH,
            joint_names=self._hand.joint_names,
            joint_positions=batch.q[k],
            pregrasp_positions=opened,
            approach_O=rotate(X_OH, self._hand.approach_H),
            contact_points=batch.points[k, pads],
            contact_normals=batch.normals[k, pads],
            contact_fingers=tuple(self._hand.fingers[pad] for pad in pads),
            contact_forces=np.zeros((len(pads), 3)),
            quality=quality,
            accepted=f"force closure at friction {self._prior.friction:g}, reached, free of"
            " collision",
        )

    def plan_forces(self, grasp: Grasp) -> Grasp:
        """Return a grasp with the largest contact forces in balance, and ``grip``."""
        forces = balanced_grip(
            grasp.contact_points,
            grasp.contact_normals,
            friction=self._prior.friction,
            total=2.0 * self._hand.max_contact_force,
        )
        forces = forces * grip_fraction(
            self._hand, grasp.X_OH, grasp.joint_positions, grasp.contact_fingers, forces
        )
        grip = -float(np.sum(forces * grasp.contact_normals))
        return replace(grasp, contact_forces=forces, quality={**grasp.quality, "grip": grip})

    def predict_success(self, grasps: Sequence[Grasp]) -> list[Grasp]:
        """Return grasps with precise qualities and the success probability over the whole prior.

        Qualities other than the success probability are those at the medians.
        """
        if not grasps:
            return []
        batch, median = _Batch.of(grasps, self._hand), self._median
        robust, plain, loaded = self._epsilons(
            batch, (median.robust, median.plain, median.loaded), _REPORTED.epsilon
        )
        expected, closure = self._over_surfaces(batch, robust, _REPORTED.surfaces)
        accelerations, carried = self._carry(batch, median, _REPORTED.acceleration)
        shape = shape_probability(expected, median.plain)
        (_, weight), *others = self._models
        success = weight * shape * carried
        for models, weight in others:
            success = success + weight * self._success(batch, models)
        values = {
            "epsilon_robust": robust,
            "closure_probability": closure,
            "epsilon_expected": expected,
            "acceleration": accelerations,
            "shape_probability": shape,
            "success_probability": success,
            "epsilon": plain,
            "load_per_grip": loaded,
            "weight_robust": resisted_forces(
                batch.points, batch.normals, (0.0, 0.0, 1.0), median.robust
            ),
        }
        return [
            replace(grasp, quality={**grasp.quality, **_each(values, k)})
            for k, grasp in enumerate(grasps)
        ]

    def loads_per_grip(self, sets: ContactSets) -> FloatArray:
        """Return ``load_per_grip`` of B contact sets, shape (B,)."""
        points, normals = sets.filled()
        return epsilon_by_expanding_polytope(
            points, normals, self._median.loaded, tolerance=_COARSE
        )

    def _epsilons(
        self, batch: _Batch, models: Sequence[WrenchModel], tolerance: float
    ) -> FloatArray:
        """Return epsilon of each grasp by each of M models, shape (M, B)."""
        wrenches = [model.wrenches(batch.points, batch.normals) for model in models]
        found = epsilon_of_wrenches(np.concatenate(wrenches), tolerance=tolerance)
        return found.reshape(len(models), -1)

    def _success(self, batch: _Batch, models: _FrictionModels) -> FloatArray:
        """Return the success probability (B,) at the friction of `models`, over masses, roughly."""
        (robust,) = self._epsilons(batch, (models.robust,), _RANKED.epsilon)
        expected, _ = self._over_surfaces(batch, robust, _RANKED.surfaces, models)
        _, carried = self._carry(batch, models, _RANKED.acceleration)
        return shape_probability(expected, models.plain) * carried

    def _carry(
        self, batch: _Batch, models: _FrictionModels, tolerance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return ``acceleration`` at the median mass, and the probability to carry the object."""
        wrenches = largest_wrenches(
            self._hand,
            models.carrying,
            batch.X_OH,
            batch.q,
            batch.used,
            batch.points,
            batch.normals,
        )
        masses, weights = np.array(list(self._prior.masses())).T
        accelerations = spare_accelerations(
            wrenches, masses, scale=self._hand.max_contact_force, tolerance=tolerance
        )
        return accelerations[0], weights @ load_probability(
            accelerations, masses[:, None], models.plain
        )

    def _over_surfaces(
        self,
        batch: _Batch,
        robust: FloatArray,
        samples: int,
        models: _FrictionModels | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the expected robust epsilon and the probability of closure, each of shape (B,)."""
        models, count = models or self._median, len(batch)
        if not count:
            return robust, np.ones(0)
        if self._surface.deviations.any():
            sampled = self._surface.sample_contacts(
                batch.points, batch.normals, samples=samples, rng=np.random.default_rng(self._seed)
            )
            used = np.repeat(batch.used, samples, axis=0)
            p, n = (fill_unused(a.reshape(*used.shape, 3), used) for a in sampled)
            robust = epsilon_by_expanding_polytope(p, n, models.robust, tolerance=_COARSE)
        else:
            samples, p, n = 1, batch.points, batch.normals
        closes = robust > 0.0  # which implies closure at the whole friction
        rest = np.flatnonzero(~closes)
        if len(rest):
            plain = epsilon_by_expanding_polytope(p[rest], n[rest], models.plain, tolerance=_COARSE)
            closes[rest] = plain > 0.0
        by_grasp = (count, samples)
        return robust.reshape(by_grasp).mean(axis=1), closes.reshape(by_grasp).mean(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """B grasps by a hand of F pads. Pads without contact have another pad's contact, twice."""

    points: FloatArray  # (B, F, 3) [m], in O
    normals: FloatArray  # (B, F, 3), unit, outward
    used: BoolArray  # (B, F): which pads have a contact
    X_OH: FloatArray  # (B, 4, 4)
    q: FloatArray  # (B, J) [rad or m]

    @classmethod
    def of_candidates(cls, candidates: GraspCandidates) -> _Batch:
        """Return candidates as a batch."""
        contacts, postures = candidates.contacts, candidates.postures
        return cls(*contacts.filled(), contacts.used, postures.X_OH, postures.q)

    @classmethod
    def of(cls, grasps: Sequence[Grasp], hand: Hand) -> _Batch:
        """Return grasps as a batch."""
        sets = contacts_of(grasps, hand)
        return cls(
            *sets.filled(),
            sets.used,
            np.array([grasp.X_OH for grasp in grasps]),
            np.array([grasp.joint_positions for grasp in grasps]),
        )

    def __len__(self) -> int:
        return len(self.points)

    def subset(self, index: IndexArray) -> _Batch:
        """Return some of the grasps."""
        return subset_of(self, index)


def _each(values: dict[str, FloatArray], k: int) -> dict[str, float]:
    return {name: float(value[k]) for name, value in values.items()}


@dataclass(frozen=True, slots=True, eq=False)
class _FrictionModels:
    """Wrench models at one friction: of closure, of robust qualities, and of loads."""

    plain: WrenchModel
    robust: WrenchModel
    loaded: WrenchModel
    carrying: WrenchModel

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, hand: Hand, friction: float) -> _FrictionModels:
        """Return the models of a hand's contacts on a mesh."""
        plain, metric = wrench_model(mesh, hand, friction), inertial_metric(mesh)
        loaded = wrench_model(mesh, hand, _LOADED_FRACTION * friction)
        return cls(
            plain,
            wrench_model(mesh, hand, _ROBUST_FRACTION * friction),
            replace(loaded, torque_metric=metric),
            replace(plain, torque_metric=metric),
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
    if hand.kind == "parallel_jaw":
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
