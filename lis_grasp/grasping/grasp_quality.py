"""Grasp quality: quality values of candidates, their predicted success probability, ranking."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.geometry import rotate
from lis_grasp.grasping._antipodal_sampling import family_of
from lis_grasp.grasping.contact_wrenches import WrenchModel, inertial_metric, wrench_model
from lis_grasp.grasping.epsilon import (
    ROBUST_FRACTION,
    epsilon_by_expanding_polytope,
    epsilon_of_wrenches,
)
from lis_grasp.grasping.force_closure import resisted_forces
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasps import Grasp, LoadPrior
from lis_grasp.grasping.hand_capacity import (
    balanced_grip,
    grip_fraction,
    largest_wrenches,
    spare_accelerations,
)
from lis_grasp.grasping.surface_uncertainty import PadContacts
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray, IndexArray

# On sampled surfaces, epsilon may be too small by this fraction.
_COARSE = 0.05
# Loads are carried at this fraction of the friction.
_LOADED_FRACTION = 0.75

SUCCESS_MODEL = json.loads(Path(__file__).with_name("success_model.json").read_text("utf-8"))
"""Constants of the model, and what they were fitted to."""


class _Precision(NamedTuple):
    """Precision of qualities: displaced hands, and by what fraction values may be too small."""

    samples: int
    epsilon: float
    acceleration: float


# Most candidates are only ranked; what is reported is precise.
_RANKED, _REPORTED = _Precision(4, _COARSE, 0.01), _Precision(32, 1e-6, 1e-4)


class GraspScorer:
    """Computes the qualities of grasp candidates, and rejects those not in force closure.

    Each grasp gets, by name:

    - ``epsilon``: `epsilon_quality`; ``epsilon_robust``: the same at half the friction.
    - ``weight_robust``: the weight that it carries at half the friction, `resisted_force`.
    - ``closure_probability``, ``load_expected``: over displaced hands and the surfaces that the
      estimate allows (`PadContacts`), the fraction in force closure and the mean of
      ``load_per_grip``, both at half the friction.
    - ``grip``: the sum of the largest normal forces in balance that the hand exerts in this
      posture, within its joint efforts and its largest contact force [N].
    - ``load_per_grip``: the largest load, in any direction, that contacts carry per unit of grip.
    - ``acceleration``: the largest acceleration, linear or angular in any direction, that the
      fingers can add to holding the weight, within their joint efforts (`spare_accelerations`)
      [m/s^2]. Both are in the metric of `inertial_metric`.
    - ``success_probability``: the predicted probability that the hand lifts and holds the object,
      a logistic function of ``load_expected``, times another one of ``acceleration`` and mass
      (`SUCCESS_MODEL`). The acceleration is part of it because heavy objects have more weight,
      and long ones more inertia, than the motors or the friction of fingers close together carry.
    - ``shape_probability``: the first of these two factors, which knowing the surface raises.
    - ``clearance``: the distance of the links that are no fingertips from the surface [m].
    - ``pad_error``: the largest distance of a pad from its contact [m].

    `score` estimates the qualities that ranking depends on, at the median friction of the prior:
    epsilon may be too small by 5 %, and four hands are displaced. Its ``epsilon`` is only a lower
    bound, above zero. `predict_success` computes all but ``grip`` precisely, and averages the
    success probability over the distributions of mass and friction. `plan_forces` makes grasps, and
    adds ``grip``.

    Torques are taken about the centre of mass at uniform density, and divided by the largest
    distance of a vertex from it.

    Rounded pads are hard fingers with Coulomb friction, the flat pads of a parallel-jaw gripper are
    soft fingers. The mesh is closed, in O [m], with a vertex attribute ``"uncertainty"`` [m] where
    it is known. `rejected` counts candidates that `score` rejected by reason: ``no_force_closure``,
    and ``outranked``.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        *,
        prior: LoadPrior,
        rng: np.random.Generator,
        support_height: float | None = None,
    ) -> None:
        self._hand, self._prior = hand, prior
        self._models = [
            (_FrictionModels.of(mesh, hand, friction), weight)
            for friction, weight in prior.frictions()
        ]
        self._median = self._models[0][0]
        height = -np.inf if support_height is None else support_height
        self._contacts = PadContacts.on(mesh, hand, support_height=height)
        # The same draws for every grasp, whenever its qualities are computed.
        self._seed = int(rng.integers(2**63))
        self.rejected: Counter[str] = Counter()

    def score(
        self, batch: GraspBatch, least_success: FloatArray | None = None
    ) -> tuple[IndexArray, GraspBatch]:
        """Return the indices of the candidates in force closure, and these with their qualities.

        With `least_success` (B,), candidates of a smaller success probability may be rejected.
        """
        median = self._median
        (robust,) = self._epsilons(batch, (median.robust,), _RANKED.epsilon)
        plain, rest = robust.copy(), np.flatnonzero(robust == 0.0)
        (plain[rest],) = self._epsilons(batch.subset(rest), (median.plain,), _RANKED.epsilon)
        kept = np.flatnonzero(plain > 0.0)
        self.rejected["no_force_closure"] += len(batch) - len(kept)
        expected = self._displaced(batch.subset(kept), _RANKED.samples, median.robust_load).mean(
            axis=1
        )
        shape = shape_probability(expected, median.plain)
        if least_success is not None:
            likely = shape >= least_success[kept]  # of which the success probability is a part
            self.rejected["outranked"] += len(kept) - int(likely.sum())
            kept, expected, shape = kept[likely], expected[likely], shape[likely]
        batch = batch.subset(kept)
        assert batch.clearance is not None
        assert batch.position_error is not None
        accelerations, carried = self._carry(batch, median, _RANKED.acceleration)
        return kept, batch.with_quality(
            epsilon=plain[kept],
            epsilon_robust=robust[kept],
            load_expected=expected,
            acceleration=accelerations,
            shape_probability=shape,
            success_probability=shape * carried,
            clearance=batch.clearance,
            pad_error=batch.position_error,
        )

    def predict_success(self, batch: GraspBatch) -> GraspBatch:
        """Return grasps with precise qualities and the success probability over the whole prior.

        Qualities other than the success probability are computed at the medians.
        """
        if not len(batch):
            return batch
        median = self._median
        robust, plain, loaded = self._epsilons(
            batch, (median.robust, median.plain, median.loaded), _REPORTED.epsilon
        )
        loads = self._displaced(batch, _REPORTED.samples, median.robust_load)
        expected = loads.mean(axis=1)
        accelerations, carried = self._carry(batch, median, _REPORTED.acceleration)
        shape = shape_probability(expected, median.plain)
        (_, weight), *others = self._models
        success = weight * shape * carried
        for models, weight in others:
            success = success + weight * self._success(batch, models)
        return batch.with_quality(
            epsilon_robust=robust,
            closure_probability=(loads > 0.0).mean(axis=1),
            load_expected=expected,
            acceleration=accelerations,
            shape_probability=shape,
            success_probability=success,
            epsilon=plain,
            load_per_grip=loaded,
            weight_robust=resisted_forces(*batch.contacts(), (0.0, 0.0, 1.0), median.robust),
        )

    def plan_forces(self, batch: GraspBatch) -> list[Grasp]:
        """Return grasps with the largest contact forces in balance, and ``grip``."""
        return [self._grasp(batch, k) for k in range(len(batch))]

    def _grasp(self, batch: GraspBatch, k: int) -> Grasp:
        hand, pads = self._hand, np.flatnonzero(batch.used[k])
        points, normals = batch.points[k, pads], batch.normals[k, pads]
        fingers = tuple(hand.fingers[pad] for pad in pads)
        forces = balanced_grip(
            points,
            normals,
            friction=self._prior.friction,
            total=2.0 * hand.max_contact_force,
        )
        forces = forces * grip_fraction(hand, batch.X_OH[k], batch.q[k], fingers, forces)
        quality = {name: float(values[k]) for name, values in batch.quality.items()}
        assert batch.opened is not None
        return Grasp(
            hand=hand.name,
            X_OH=batch.X_OH[k],
            joint_names=hand.joint_names,
            joint_positions=batch.q[k],
            pregrasp_positions=batch.opened[k],
            approach_O=rotate(batch.X_OH[k], hand.approach_H),
            contact_points=points,
            contact_normals=normals,
            contact_fingers=fingers,
            contact_forces=forces,
            quality=quality | {"grip": -float(np.sum(forces * normals))},
            accepted=f"force closure at friction {self._prior.friction:g}, reached, free of"
            " collision",
            family=family_of(
                hand, batch.X_OH[k], batch.q[k], normals, self._contacts.support_height
            ),
        )

    def loads_per_grip(self, batch: GraspBatch) -> FloatArray:
        """Return ``load_per_grip`` of B contact sets, shape (B,)."""
        return epsilon_by_expanding_polytope(
            *batch.contacts(), self._median.loaded, tolerance=_COARSE
        )

    def _epsilons(
        self, batch: GraspBatch, models: Sequence[WrenchModel], tolerance: float
    ) -> FloatArray:
        """Return epsilon of each grasp by each of M models, shape (M, B)."""
        wrenches = [model.wrenches(*batch.contacts()) for model in models]
        epsilons = epsilon_of_wrenches(np.concatenate(wrenches), tolerance=tolerance)
        return epsilons.reshape(len(models), -1)

    def _success(self, batch: GraspBatch, models: _FrictionModels) -> FloatArray:
        """Return the success probability (B,) at the friction of `models`, over masses, roughly."""
        loads = self._displaced(batch, _RANKED.samples, models.robust_load)
        _, carried = self._carry(batch, models, _RANKED.acceleration)
        return shape_probability(loads.mean(axis=1), models.plain) * carried

    def _carry(
        self, batch: GraspBatch, models: _FrictionModels, tolerance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return ``acceleration`` at the median mass, and the probability to carry the object."""
        masses, weights = np.array(list(self._prior.masses())).T
        points, normals = batch.contacts()
        found = []
        for center, weight in self._prior.centers():
            wrenches = largest_wrenches(
                self._hand,
                models.carrying,
                batch.X_OH,
                batch.q,
                batch.used,
                points - center,
                normals,
            )
            accelerations = spare_accelerations(
                wrenches, masses, scale=self._hand.max_contact_force, tolerance=tolerance
            )
            carried = weights @ load_probability(accelerations, masses[:, None], models.plain)
            found.append((accelerations[0], weight * carried))
        return found[0][0], np.sum([carried for _, carried in found], axis=0)

    def _displaced(self, batch: GraspBatch, samples: int, model: WrenchModel) -> FloatArray:
        """Return the robust loads per grip of displaced hands, shape (B, samples)."""
        sampled = self._contacts.sample(batch, samples=samples, seed=self._seed)
        points, normals = (a.reshape(-1, *a.shape[2:]) for a in sampled)
        loads = epsilon_by_expanding_polytope(points, normals, model, tolerance=_COARSE)
        return loads.reshape(len(batch), samples)


@dataclass(frozen=True, slots=True, eq=False)
class _FrictionModels:
    """Wrench models at one friction: of closure, robust qualities, loads, and robust loads."""

    plain: WrenchModel
    robust: WrenchModel
    loaded: WrenchModel
    robust_load: WrenchModel
    carrying: WrenchModel

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, hand: Hand, friction: float) -> _FrictionModels:
        """Return the models of a hand's contacts on a mesh."""
        plain, robust, loaded = (
            wrench_model(mesh, hand, fraction * friction)
            for fraction in (1.0, ROBUST_FRACTION, _LOADED_FRACTION)
        )
        metric = inertial_metric(mesh)
        carried = (replace(m, torque_metric=metric) for m in (loaded, robust, plain))
        return cls(plain, robust, *carried)


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


def shape_probability(load_expected: npt.ArrayLike, model: WrenchModel) -> FloatArray:
    """Return the predicted probability that a grasp holds an object of hardly any weight.

    It depends on the surface and on its uncertainty: the quality ``load_expected``. It is never 1:
    the lifts of the fit do not show every reason for losing an object.
    """
    shape, offset = SUCCESS_MODEL["shape"][model.contact_model], SUCCESS_MODEL["offsets"]
    logs = np.log(np.asarray(load_expected) + offset["load_expected"])
    logit = shape["intercept"] + shape["slope"] * logs
    return np.asarray(SUCCESS_MODEL["ceiling"] / (1.0 + np.exp(-logit)))
