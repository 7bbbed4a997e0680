"""Sampling-based planner of grasps with a suction cup: places that seal and carry the load."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.geometry import frame_along, inverse_pose, make_pose, rotate, tangent_frame
from lis_grasp.grasping._candidate_filter import CandidateFilter
from lis_grasp.grasping.cup_wrenches import CupWrenches
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasps import Grasp, GraspSearch, LoadPrior, Reach
from lis_grasp.grasping.lift_path import STRAIGHT_LIFTS, LiftPath
from lis_grasp.grasping.planned_meshes import require_closed
from lis_grasp.grasping.sampler import CANDIDATES
from lis_grasp.grasping.seals import Seals, press_cups
from lis_grasp.grasping.surface_uncertainty import PALM_ERROR, allowed_meshes
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import Cup
from lis_grasp.shapes.mesh_distance import MeshTree
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import FloatArray, Seed
from lis_grasp.underflow import underflows
from lis_grasp.world import ALONE, Surroundings

# Places a batch; sampling ends after so many that seal and that the hand reaches.
_BATCH, _POOL = 100, 60
# Surfaces that the estimate allows, on which each place is tried.
_SURFACES = 32


class SuctionSampler:
    """Plans grasps of a hand with one suction cup.

    Places are drawn by area on the mesh. A place is kept where the cup seals (`press_cups`) and
    where the hand, turned about the cup's axis at random, does not collide, as
    `ForceClosureSampler` checks it. Each is tried on 32 surfaces that the estimate's uncertainty
    allows (`allowed_meshes`), with the robot's error of place. Grasps have, by name:

    - ``closure_probability``: the fraction of these surfaces on which the cup seals;
    - ``success_probability``: the fraction on which it seals and carries the object, over the prior
      of mass, friction and centre of mass, through a shake of 1 g in any direction: the ranking;
    - ``acceleration``: the largest acceleration, in any direction, that the sealed cup adds to
      holding the weight at the medians [m/s^2] (`CupWrenches`). Of equals, the largest product
      with ``closure_probability`` is first;
    - ``epsilon``: the largest wrench, in any direction, per newton of pull, torques about the
      centre of mass and divided by the largest distance of a vertex from it;
    - ``load_per_grip``: the same of forces alone, at the centre of mass;
    - ``grip``: the pull of the sealed cup [N];
    - ``clearance``: the distance of links other than lip and fingertips from the surface [m].

    Arguments are as in `ForceClosureSampler`; `candidates` are places.

    Raises `InvalidOptionError` if the hand has no suction cup.

    Examples
    --------
    >>> sampler = SuctionSampler(Hand.load("cup"), candidates=400)
    >>> best = sampler.sample(shapes.find("box").mesh, count=1).best
    >>> best.family, best.quality["closure_probability"]
    ('suction', 1.0)
    """

    def __init__(
        self,
        hand: Hand,
        prior: LoadPrior | None = None,
        *,
        candidates: int = CANDIDATES,
        station: Reach | None = None,
        surroundings: Surroundings = ALONE,
        lifts: Sequence[LiftPath] = STRAIGHT_LIFTS,
        margin: float = 0.0,
    ) -> None:
        require_at_least(1, candidates=candidates)
        if hand.cup is None:
            raise InvalidOptionError(
                f"SuctionSampler needs a hand of kind suction_cup; '{hand.name}' is of kind"
                f" {hand.kind}: call lis_grasp.plan, which takes the sampler of the hand",
                option="hand",
                value=hand.name,
            )
        self.hand, self.prior, self.candidates = hand, prior or LoadPrior(), candidates
        self.station, self.surroundings = station, surroundings
        self.lifts, self.margin = tuple(lifts), margin

    @underflows
    def sample(
        self,
        mesh: trimesh.Trimesh,
        *,
        rng: Seed = 0,
        support_height: float | None = None,
        count: int = 10,
    ) -> GraspSearch:
        """Return up to `count` ranked grasps; for arguments and errors see `ForceClosureSampler`.

        The vertex attribute ``"uncertainty"`` [m] decides how probable a seal is.
        """
        require_closed(mesh)
        rng = np.random.default_rng(rng)
        candidate_filter = CandidateFilter(
            self.hand,
            mesh,
            support_height=support_height,
            reach=self.station,
            surroundings=self.surroundings,
            lifts=self.lifts,
            margin=self.margin,
        )
        tree, drawn, found = MeshTree(mesh), 0, None
        rejected: Counter[str] = Counter()
        while drawn < self.candidates and (found is None or len(found) < _POOL):
            places = min(_BATCH, self.candidates - drawn)
            drawn += places
            sealed = self._sealed_places(mesh, tree, places, rng)
            rejected["no_seal"] += places - len(sealed)
            _, free = candidate_filter.filter_cups(sealed)
            found = free if found is None else found.joined(free)
        assert found is not None
        best = self._ranked(mesh, found, rng)[:count]
        rejected["outranked"] += len(found) - len(best)
        return candidate_filter.search(best, rejected, drawn)

    def _sealed_places(
        self, mesh: trimesh.Trimesh, tree: MeshTree, places: int, rng: np.random.Generator
    ) -> GraspBatch:
        """Return the grasps at places drawn by area where the cup seals."""
        points, faces = trimesh.sample.sample_surface(mesh, places, seed=int(rng.integers(2**31)))
        pressed = press_cups(tree, np.asarray(points), mesh.face_normals[faces], self._cup)
        yaws = rng.uniform(0.0, 2.0 * np.pi, size=places)
        kept = np.flatnonzero(pressed.sealed)
        centers, axes, yaws = pressed.centers[kept], pressed.axes[kept], yaws[kept]
        q = np.repeat(next(iter(self.hand.pregrasps.values()))[None], len(kept), axis=0)
        X_OH = self._palms(centers, axes, yaws)
        used = np.ones((len(kept), 1), dtype=np.bool_)
        return GraspBatch(centers[:, None], axes[:, None], used, X_OH, q)

    def _palms(self, centers: FloatArray, axes: FloatArray, yaws: FloatArray) -> FloatArray:
        """Return the palms (B, 4, 4) with relaxed cups at centers (B, 3), turned by yaws (B,)."""
        hand, q = self.hand, next(iter(self.hand.pregrasps.values()))
        (center,), (axis,) = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)
        X_HC = make_pose(frame_along(axis, tangent_frame(axis)[0]), center)
        frames = tangent_frame(-axes)  # (B, 2, 3)
        ahead = np.einsum("bi,bij->bj", np.stack([np.cos(yaws), np.sin(yaws)], axis=-1), frames)
        R_OC = np.stack([ahead, np.cross(-axes, ahead), -axes], axis=-1)
        return np.asarray(make_pose(R_OC, centers) @ inverse_pose(X_HC))

    def _ranked(
        self, mesh: trimesh.Trimesh, batch: GraspBatch, rng: np.random.Generator
    ) -> list[Grasp]:
        """Return grasps with their qualities, the best first."""
        if not len(batch):
            return []
        scores = _scores(mesh, batch.points[:, 0], batch.normals[:, 0], self._cup, self.prior, rng)
        assert batch.clearance is not None
        batch = batch.with_quality(**scores, clearance=batch.clearance)
        spare = scores["closure_probability"] * scores["acceleration"]
        order = np.lexsort((-spare, -scores["success_probability"]))
        return [self._grasp(batch, k) for k in order]

    def _grasp(self, batch: GraspBatch, k: int) -> Grasp:
        hand = self.hand
        return Grasp(
            hand=hand.name,
            X_OH=batch.X_OH[k],
            joint_names=hand.joint_names,
            joint_positions=batch.q[k],
            pregrasp_positions=batch.q[k],
            approach_O=rotate(batch.X_OH[k], hand.approach_H),
            contact_points=batch.points[k],
            contact_normals=batch.normals[k],
            contact_fingers=hand.fingers,
            contact_forces=-hand.max_contact_force * batch.normals[k],
            quality={name: float(values[k]) for name, values in batch.quality.items()},
            accepted="the cup seals, reached, free of collision",
            family="suction",
        )

    @property
    def _cup(self) -> Cup:
        assert self.hand.cup is not None
        return self.hand.cup


def _scores(
    mesh: trimesh.Trimesh,
    points: FloatArray,
    axes: FloatArray,
    cup: Cup,
    prior: LoadPrior,
    rng: np.random.Generator,
) -> dict[str, FloatArray]:
    """Return the qualities of cups at points (B, 3) [m], with outward axes (B, 3), each (B,)."""
    off = PALM_ERROR * rng.normal(size=(_SURFACES, 3))
    sealed, carried = np.zeros((2, len(points)))
    for moved, allowed in zip(off, allowed_meshes(mesh, _SURFACES, rng=rng), strict=True):
        # The hand goes on along the axis until the lip touches.
        tree = MeshTree(allowed)
        pressed = press_cups(tree, tree.nearest(points + moved)[2], axes, cup)
        sealed = sealed + pressed.sealed
        carried = carried + pressed.sealed * _carried(
            pressed, np.asarray(allowed.center_mass), cup, prior
        )
    center = np.asarray(mesh.center_mass)
    length = float(np.linalg.norm(mesh.vertices - center, axis=1).max())
    wrenches = CupWrenches.of(cup, prior.friction, points, axes, origin=center)
    none, weight = wrenches.spare_forces(np.array([0.0, GRAVITY * prior.mass]))
    return {
        "epsilon": wrenches.epsilon(length) / cup.pull,
        "closure_probability": sealed / _SURFACES,
        "success_probability": carried / _SURFACES,
        "acceleration": weight / prior.mass,
        "load_per_grip": none / cup.pull,
        "grip": np.full(len(points), cup.pull),
    }


def cup_epsilon(
    mesh: trimesh.Trimesh, cup: Cup, points: FloatArray, axes: FloatArray, *, friction: float
) -> FloatArray:
    """Return ``epsilon`` of cups that are pressed on a mesh, (B,), 0 without a seal.

    They press at points (B, 3) [m] of it, against outward axes (B, 3), in O.

    Examples
    --------
    >>> box = shapes.find("box").mesh
    >>> top, up = np.array([[0.0, 0.0, box.bounds[1, 2]]]), np.array([[0.0, 0.0, 1.0]])
    >>> cup_epsilon(box, Hand.load("cup").cup, top, up, friction=0.5).round(2)
    array([0.05])
    """
    pressed = press_cups(MeshTree(mesh), points, axes, cup)
    center = np.asarray(mesh.center_mass)
    length = float(np.linalg.norm(mesh.vertices - center, axis=1).max())
    wrenches = CupWrenches.of(cup, friction, pressed.centers, pressed.axes, origin=center)
    return np.asarray(np.where(pressed.sealed, wrenches.epsilon(length) / cup.pull, 0.0))


def _carried(pressed: Seals, center: FloatArray, cup: Cup, prior: LoadPrior) -> FloatArray:
    """Return how probably sealed cups carry the load through a shake of 1 g, (B,)."""
    masses, weights = np.array(list(prior.masses())).T
    likely = np.zeros(len(pressed.sealed))
    for friction, by_friction in prior.frictions():
        for displaced, by_center in prior.centers():
            wrenches = CupWrenches.of(
                cup, friction, pressed.centers, pressed.axes, origin=center + displaced
            )
            holds = wrenches.spare_forces(GRAVITY * masses) >= GRAVITY * masses[:, None]  # (M, B)
            likely = likely + by_friction * by_center * (weights @ holds)
    return likely
