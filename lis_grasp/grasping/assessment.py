"""What grasps are worth: one choice of origin, length scale and contact model, and of a rank."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import trimesh

from lis_grasp.grasping.contact_model import ContactModel
from lis_grasp.grasping.contact_search import ContactSets
from lis_grasp.grasping.force_closure import resisted_force
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.grip import balanced_grip
from lis_grasp.grasping.inverse_kinematics import Postures
from lis_grasp.grasping.quality import epsilon_qualities, epsilon_quality
from lis_grasp.grasping.shape_uncertainty import UncertainSurface
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray

# Contacts are known to a few degrees only: grasps are ranked at this share of the friction.
_ROBUST_SHARE = 0.5
# Surfaces that the estimate may stand for, to see in how many of them a grasp closes.
_SAMPLES = 32
# Of each of them epsilon may be too small by this share: on average it is by much less.
_COARSE = 0.05
# Logit of success, and its slopes against the logarithms of the expected epsilon and of the weight:
# fitted to 261 lifts of 0.2 kg by benchmarks/bench_calibration.py, planned on `blend` surfaces of 5
# to 15 contacts; seeds 2000 and 2001.
_SUCCESS: Mapping[ContactModel, float] = MappingProxyType({"coulomb": 7.2, "soft_finger": 8.0})
_SUCCESS_SLOPES = (1.05, 1.0)
# A flat pad resists turning about its normal with about this lever [m]: a patch of 9 mm radius
# under even pressure, two thirds of the radius (Howe and Cutkosky 1996).
_FLAT_PAD_LEVER = 0.006


@dataclass(frozen=True, slots=True, eq=False)
class PlacedHands:
    """Contact sets with the postures that reach them, B of each.

    Parameters
    ----------
    sets, postures
        The contacts, and palm and joints at them.
    opened
        Shape (B, J): joint positions with every used pad off its contact.
    """

    sets: ContactSets
    postures: Postures
    opened: FloatArray

    def __len__(self) -> int:
        return len(self.sets)


class GraspAssessor:
    """Makes grasps of placed hands, with their qualities; drops those not in force closure.

    Each grasp gets, by name:

    - ``epsilon``: `epsilon_quality`; ``epsilon_robust``: the same at half the friction.
    - ``weight_robust``: the weight that it carries at half the friction, `resisted_force`.
    - ``closure_probability``, ``epsilon_expected``: over the surfaces that the estimate may stand
      for (`UncertainSurface`), the share on which it closes, and the mean of ``epsilon_robust``.
    - ``success_probability``: how likely it is to lift and hold the true object, a logistic
      function of the last and of the weight (wrenches from anywhere, and the one that is sure to
      come: epsilon alone prefers long levers, and lets an object turn under its own weight about
      the line through the fingers). Grasps are ranked by it.
    - ``pad_error``: the largest distance of a pad from its contact [m].

    Torques are taken about the centre of mass at uniform density, and divided by the largest
    distance of a vertex from it.

    Parameters
    ----------
    hand
        Whose pads touch. Rounded pads are hard fingers with Coulomb friction, a jaw's flat pads
        soft fingers.
    mesh
        Closed mesh of the object in O [m], true or estimated, with a vertex attribute
        ``"uncertainty"`` [m] where it is known.
    friction
        Coulomb coefficient.
    rng
        For the surfaces that the estimate may stand for.
    """

    def __init__(
        self, hand: Hand, mesh: trimesh.Trimesh, *, friction: float, rng: np.random.Generator
    ) -> None:
        self._hand, self._friction = hand, friction
        self._model, self._torsion_share = _contact_model(hand)
        self._surface = UncertainSurface.from_mesh(mesh)
        self._center, self._length = _frame(mesh)
        # The same draws for every grasp, whenever it is assessed.
        self._seed = rng.integers(2**63)

    def assess(self, placed: PlacedHands) -> dict[int, Grasp]:
        """Return the grasps in force closure among hands, by their index."""
        found: dict[int, Grasp] = {}
        for alike, points, normals in placed.sets.by_count():
            plain, robust = (
                self.epsilons(points, normals, share=share) for share in (1.0, _ROBUST_SHARE)
            )
            closing = np.flatnonzero(plain > 0.0)
            if not len(closing):
                continue
            closure, expected = self._over_surfaces(
                points[closing], normals[closing], robust[closing]
            )
            for k, i in enumerate(closing):
                weight = self._robust_weight(points[i], normals[i])
                quality = {
                    "epsilon": plain[i],
                    "epsilon_robust": robust[i],
                    "weight_robust": weight,
                    "closure_probability": closure[k],
                    "epsilon_expected": expected[k],
                    "success_probability": self._success_probability(expected[k], weight),
                    "pad_error": placed.postures.position_error[alike[i]],
                }
                b = int(alike[i])
                found[b] = self._grasp(placed, b, points[i], normals[i], quality)
        return dict(sorted(found.items()))

    def robust_epsilons(self, sets: ContactSets) -> FloatArray:
        """Return ``epsilon_robust`` of B contact sets, before a hand is placed; shape (B,)."""
        found = np.zeros(len(sets))
        for alike, points, normals in sets.by_count():
            found[alike] = self.epsilons(points, normals, share=_ROBUST_SHARE)
        return found

    def epsilons(
        self, points: FloatArray, normals: FloatArray, *, share: float, tolerance: float = 0.0
    ) -> FloatArray:
        """Return epsilon of contacts (B, C, 3) at a share of the friction, shape (B,)."""
        friction = share * self._friction
        return epsilon_qualities(
            points,
            normals,
            friction=friction,
            origin=self._center,
            length_scale=self._length,
            model=self._model,
            torsion=friction * self._torsion_share,
            tolerance=tolerance,
        )

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
        flat = [a.reshape(-1, contacts, 3) for a in sampled]
        robust = self.epsilons(*flat, share=_ROBUST_SHARE, tolerance=_COARSE)
        closes = robust > 0.0  # then it does so at the whole friction, too
        rest = np.flatnonzero(~closes)
        if len(rest):
            closes[rest] = (
                self.epsilons(*(a[rest] for a in flat), share=1.0, tolerance=_COARSE) > 0.0
            )
        by_grasp = (count, _SAMPLES)
        return closes.reshape(by_grasp).mean(axis=1), robust.reshape(by_grasp).mean(axis=1)

    def _robust_weight(self, points: FloatArray, normals: FloatArray) -> float:
        """Return the weight [N] that contacts carry for each newton of their normal forces."""
        friction = _ROBUST_SHARE * self._friction
        return resisted_force(
            points,
            normals,
            (0.0, 0.0, 1.0),
            friction=friction,
            origin=self._center,
            model=self._model,
            torsion=friction * self._torsion_share,
        )

    def _success_probability(self, expected: float, weight: float) -> float:
        by_epsilon, by_weight = _SUCCESS_SLOPES
        logit = _SUCCESS[self._model]
        logit += by_epsilon * np.log(expected + 1e-3) + by_weight * np.log(weight + 0.02)
        return float(1.0 / (1.0 + np.exp(-logit)))

    def _grasp(
        self,
        placed: PlacedHands,
        b: int,
        points: FloatArray,
        normals: FloatArray,
        quality: dict[str, float],
    ) -> Grasp:
        hand, X_OH = self._hand, placed.postures.X_OH[b]
        return Grasp(
            hand=hand.name,
            X_OH=X_OH,
            joint_names=hand.joint_names,
            joint_positions=placed.postures.q[b],
            pregrasp_positions=placed.opened[b],
            approach_O=X_OH[:3, :3] @ hand.approach_H,
            contact_points=points,
            contact_normals=normals,
            contact_fingers=tuple(
                finger for finger, on in zip(hand.fingers, placed.sets.used[b], strict=True) if on
            ),
            contact_forces=balanced_grip(
                points, normals, friction=self._friction, total=2.0 * hand.max_contact_force
            ),
            quality=quality,
            accepted=f"force closure at friction {self._friction:g}, reached, free of collision",
        )


def epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return epsilon of a hand's contacts (C, 3) on an object, as `GraspAssessor` would."""
    center, length = _frame(mesh)
    model, torsion_share = _contact_model(hand)
    return epsilon_quality(
        points,
        normals,
        friction=friction,
        origin=center,
        length_scale=length,
        model=model,
        torsion=friction * torsion_share,
    )


def robust_epsilon_on(
    mesh: trimesh.Trimesh, hand: Hand, points: FloatArray, normals: FloatArray, *, friction: float
) -> float:
    """Return epsilon of a hand's contacts (C, 3) at half the friction, as grasps count on it.

    Of 186 lifts whose fingers felt the object, planned on 5 to 15 touches, 137 of the 147 with more
    than zero of it held, and 10 of the 39 others.
    """
    return epsilon_on(mesh, hand, points, normals, friction=_ROBUST_SHARE * friction)


def _frame(mesh: trimesh.Trimesh) -> tuple[FloatArray, float]:
    center = np.asarray(mesh.center_mass)
    return center, float(np.linalg.norm(mesh.vertices - center, axis=1).max())


def _contact_model(hand: Hand) -> tuple[ContactModel, float]:
    """Return a hand's contact model, and its torsion over the friction [m]."""
    return ("soft_finger", _FLAT_PAD_LEVER) if hand.kind == "jaw" else ("coulomb", 0.0)
