"""Where fingers could touch: sets of contacts that oppose each other across a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.grasping.contact_samples import REACH, SurfaceSamples
from lis_grasp.hands.hand import Hand
from lis_grasp.typing import FloatArray

# Contacts oppose each other when their normals do, within these angles [rad]: straight across from
# the thumb, and for the fingers, each of which may have a face of its own (a prism's).
_OPPOSED_ANGLE, _FINGER_ANGLE = np.deg2rad(38.0), np.deg2rad(48.0)
# The thumb pushes sideways: its normal is no steeper than this above or below the horizontal.
_STEEPEST = np.sin(np.deg2rad(40.0))
_APPROACH_ANGLES = np.deg2rad([0.0, 0.0, -20.0, 20.0, -40.0, 40.0, -65.0, 65.0])
_SPREADS = (0.55, 0.75, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ContactSets:
    """B sets of contacts, one contact a pad, with the palm's orientation that they are meant for.

    Parameters
    ----------
    points, normals
        Shape (B, F, 3): in O [m], and unit, outward; zeros where a pad is not used.
    used
        Shape (B, F), bool.
    R_OH
        Shape (B, 3, 3): the palm's orientation.
    """

    points: FloatArray
    normals: FloatArray
    used: npt.NDArray[np.bool_]
    R_OH: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    def by_count(self) -> Iterator[tuple[npt.NDArray[np.intp], FloatArray, FloatArray]]:
        """Yield sets of equally many contacts: their indices (b,), points and normals (b, C, 3)."""
        counts = self.used.sum(axis=1)
        for count in np.unique(counts):
            alike = np.flatnonzero(counts == count)
            used = self.used[alike]
            points, normals = self.points[alike][used], self.normals[alike][used]
            yield alike, points.reshape(-1, count, 3), normals.reshape(-1, count, 3)

    def subset(self, index: npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> ContactSets:
        """Return some of the sets."""
        return ContactSets(
            self.points[index], self.normals[index], self.used[index], self.R_OH[index]
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Opposition:
    """How a hand's pads oppose each other in its palm frame: one pad against all others."""

    thumb: int
    others: tuple[int, ...]
    frame_H: (
        FloatArray  # (3, 3), columns: approach, lateral, closing (from the thumb to the others)
    )
    lateral: FloatArray  # (F,) [m]: the pads' places along the lateral axis


def find_contact_sets(
    hand: Hand, samples: SurfaceSamples, *, count: int, rng: np.random.Generator
) -> tuple[ContactSets, dict[str, int]]:
    """Draw sets of contacts with one pad against the others, and count the draws that failed.

    The thumb's contact is drawn from the samples; the others lie where lines against its normal,
    beside each other as the fingers are, leave the object again. Normals that face each other make
    force closure possible (Nguyen 1988); it is checked by whoever uses the sets.

    Parameters
    ----------
    hand, samples
        The hand, and where it may touch.
    count
        Draws to make.
    rng
        For every draw.
    """
    opposition = _opposition(hand)
    pads = len(hand.pads)
    rejected = {"steep": 0, "no_opposing_surface": 0, "no_surface_for_a_finger": 0}
    sets: list[tuple[FloatArray, FloatArray, npt.NDArray[np.bool_], FloatArray]] = []
    for _ in range(count):
        i = int(rng.integers(len(samples)))
        angle = float(rng.choice(_APPROACH_ANGLES)) + float(rng.normal(0.0, 0.05))
        chosen = _choose_fingers(opposition, rng)
        spread = float(rng.choice(_SPREADS))
        p, n = samples.points[i], samples.normals[i]
        if abs(n[2]) > _STEEPEST:
            rejected["steep"] += 1
            continue
        across = _far_side(samples, p, n)
        if across is None:
            rejected["no_opposing_surface"] += 1
            continue
        R_OH = _orientation(-n, angle) @ opposition.frame_H.T
        lateral_O = R_OH @ opposition.frame_H[:, 1]
        offsets = spread * (opposition.lateral[chosen] - opposition.lateral[chosen].mean())
        fingers = _meet_surface(samples, across + offsets[:, None] * lateral_O, n)
        if fingers is None:
            rejected["no_surface_for_a_finger"] += 1
            continue
        points, normals = np.zeros((pads, 3)), np.zeros((pads, 3))
        points[opposition.thumb], normals[opposition.thumb] = p, n
        points[chosen], normals[chosen] = fingers
        used = np.zeros(pads, dtype=bool)
        used[[opposition.thumb, *chosen]] = True
        sets.append((points, normals, used, R_OH))
    if not sets:
        empty = np.zeros((0, pads, 3))
        return ContactSets(empty, empty, np.zeros((0, pads), bool), np.zeros((0, 3, 3))), rejected
    points_, normals_, used_, R_ = (np.array(column) for column in zip(*sets, strict=True))
    return ContactSets(points_, normals_, used_, R_), rejected


def initial_postures(hand: Hand, sets: ContactSets) -> tuple[FloatArray, FloatArray]:
    """Return where to start reaching: palm poses (B, 4, 4) and joint positions (B, J).

    Each set starts from the pregrasp whose opening is the narrowest that clears the contacts, with
    the opened pads' middle at the contacts' middle.
    """
    pregrasps = np.array(list(hand.pregrasps.values()))  # (G, J)
    centers_H = hand.pad_centers(np.eye(4), pregrasps)  # (G, F, 3)
    radii = np.array([pad.radius for pad in hand.pads])
    opposition = _opposition(hand)
    X_OH = np.tile(np.eye(4), (len(sets), 1, 1))
    X_OH[:, :3, :3] = sets.R_OH
    chosen = np.empty(len(sets), dtype=np.intp)
    for b in range(len(sets)):
        used = [f for f in opposition.others if sets.used[b, f]]
        thumb = opposition.thumb
        targets = sets.points[b] + radii[:, None] * sets.normals[b]
        width = np.linalg.norm(targets[used].mean(axis=0) - targets[thumb])
        gaps = np.linalg.norm(centers_H[:, used].mean(axis=1) - centers_H[:, thumb], axis=-1)
        excess = gaps - width
        chosen[b] = np.argmin(
            np.where(excess >= 0.0, excess, np.inf if excess.max() >= 0 else -excess)
        )
        middle_H = 0.5 * (centers_H[chosen[b], thumb] + centers_H[chosen[b]][used].mean(axis=0))
        middle_O = 0.5 * (targets[thumb] + targets[used].mean(axis=0))
        X_OH[b, :3, 3] = middle_O - sets.R_OH[b] @ middle_H
    return X_OH, pregrasps[chosen]


def _opposition(hand: Hand) -> _Opposition:
    q = next(iter(hand.pregrasps.values()))
    centers, axes = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)
    # The thumb is the pad that faces the others: least aligned with their mean axis.
    facing = [
        float(axes[f] @ np.delete(axes, f, axis=0).mean(axis=0)) for f in range(len(hand.pads))
    ]
    thumb = int(np.argmin(facing))
    others = tuple(f for f in range(len(hand.pads)) if f != thumb)
    approach = hand.approach_H
    closing = centers[list(others)].mean(axis=0) - centers[thumb]
    if len(others) > 1:
        spread = centers[others[0]] - centers[others[-1]]
        closing = closing - spread * (closing @ spread) / (spread @ spread)
    closing = closing - approach * (closing @ approach)
    closing /= np.linalg.norm(closing)
    lateral = np.cross(closing, approach)
    frame = np.column_stack([approach, lateral, closing])
    return _Opposition(thumb, others, frame, centers @ lateral)


def _choose_fingers(opposition: _Opposition, rng: np.random.Generator) -> list[int]:
    """Return neighbouring fingers to use: all of them half of the time, else a pair."""
    others = sorted(opposition.others, key=lambda f: opposition.lateral[f])
    if len(others) < 3 or rng.random() < 0.5:
        return others
    start = int(rng.integers(len(others) - 1))
    return others[start : start + 2]


def _orientation(closing: FloatArray, angle: float) -> FloatArray:
    """Return columns (approach, lateral, closing) in O: downwards, turned by `angle`."""
    down = np.array([0.0, 0.0, -1.0])
    approach = down - closing * (down @ closing)
    approach /= np.linalg.norm(approach)
    approach = np.cos(angle) * approach + np.sin(angle) * np.cross(closing, approach)
    return np.column_stack([approach, np.cross(closing, approach), closing])


def _far_side(samples: SurfaceSamples, p: FloatArray, n: FloatArray) -> FloatArray | None:
    """Return where the line from p against n last leaves the object, or None."""
    relative = samples.points - p
    depth = -(relative @ n)  # (S,)
    beside = np.linalg.norm(relative + depth[:, None] * n, axis=1)
    opposed = (samples.normals @ n < -np.cos(_OPPOSED_ANGLE)) & (beside < REACH) & (depth > 0.0)
    if not opposed.any():
        return None
    index = np.flatnonzero(opposed)
    outermost = index[depth[index] > depth[index].max() - 0.003]
    j = int(outermost[np.argmin(beside[outermost])])
    return samples.met(p, -n, j)


def _meet_surface(
    samples: SurfaceSamples, points: FloatArray, n: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return contacts and normals (K, 3) nearest to points, on lines along n; or None."""
    assert samples.tree is not None
    distances, nearest = samples.tree.query(points, distance_upper_bound=2.5 * REACH)
    if not np.isfinite(distances).all():
        return None
    normals = samples.normals[nearest]
    if (normals @ n > -np.cos(_FINGER_ANGLE)).any():
        return None
    met = np.array([samples.met(p, -n, j) for p, j in zip(points, nearest, strict=True)])
    if np.linalg.norm(met - samples.points[nearest], axis=1).max() > REACH:
        return None
    return met, normals
