"""Grasp planner: a Drake system from an estimated surface to ranked grasps."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem

from lis_grasp.contacts import Contacts
from lis_grasp.drake._drawing import Drawing, show_hand
from lis_grasp.drake._ports import MadeOnce, declare_output, read_port
from lis_grasp.drake.surface_estimator import Estimate
from lis_grasp.exceptions import require_positive
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.grasping.grasps import Grasp, GraspSearch, LoadPrior, Reach
from lis_grasp.grasping.sampler import CANDIDATES
from lis_grasp.grasping.samplers import sampler_of
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.hand_plant import HandInPlant, require_in_plant
from lis_grasp.simulation.drake.plant_parts import pose_of, require_type, rigid
from lis_grasp.stages.estimate import Perception
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Body, Surroundings

_BEST, _OTHER = (0.1, 0.6, 0.25, 1.0), (0.3, 0.5, 0.9, 0.25)  # colours


class GraspPlanner(LeafSystem):
    """Plans force-closure grasps of a hand on an estimated surface.

    .. code-block:: text

        estimate -> GraspPlanner -> grasp, plan, joint_positions, pregrasp_positions,
                                    squeeze_efforts

    ``grasp`` is the best one as ``(cost, X_WG)``: 1 minus its predicted success, and the desired
    pose of the base link's body; ``(inf, identity)`` if there is none. ``plan`` is the
    `GraspSearch`, with poses of the palm in E. The others are vectors (J,) in the order of the
    hand's actuators: joint positions in contact, opened ones, and efforts ``J^T f`` of the planned
    forces. The system plans when an output is used, once for each estimate; this takes some
    seconds.

    Parameters
    ----------
    hand
        The hand in the plant.
    X_WE
        Pose of E in the world.
    table
        Height in E of the plane that the object is on [m].
    prior
        Mass and friction of the object; None for 0.2 kg and 0.8.
    count
        Grasps to plan.
    seed
        Seed of all random draws.
    candidates
        Most sampled contact sets.
    station
        The arm that must reach the grasps, as a `Station` with its base in E.
    surroundings
        Known bodies in the world, which the hand and what it carries must not hit.
    obstacles
        The same as a mesh [m] in E, which may be open; until 4.0.
    meshcat
        Draws the grasps when they are planned, the best one opaque.
    path
        Path of the drawing.

    Examples
    --------
    >>> plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.002)
    >>> hand = add_hand(plant, "wsg50")
    >>> plant.Finalize()
    >>> planner = GraspPlanner(hand, table=0.0, count=3)
    >>> planner.get_input_port().get_name(), planner.grasp.get_name()
    ('estimate', 'grasp')
    """

    def __init__(
        self,
        hand: HandInPlant,
        *,
        X_WE: RigidTransform | None = None,
        table: float | None = None,
        prior: LoadPrior | None = None,
        count: int = 5,
        seed: int = 0,
        candidates: int = CANDIDATES,
        station: Reach | None = None,
        surroundings: Surroundings = ALONE,
        obstacles: trimesh.Trimesh | None = None,
        meshcat: Meshcat | None = None,
        path: str = "lis_grasp/grasps",
    ) -> None:
        super().__init__()
        require_in_plant("GraspPlanner", hand)
        require_type("prior", prior, LoadPrior)
        require_type("surroundings", surroundings, Surroundings)
        require_type("obstacles", obstacles, trimesh.Trimesh)
        require_positive(count=count)
        self._hand, self._table, self._count, self._seed = hand.hand, table, count, seed
        self._X_WE, self._actuated = pose_of(X_WE, "X_WE"), hand.actuated
        if obstacles is not None:
            surroundings = Surroundings((*surroundings, Body.of_mesh("obstacles", obstacles)))
        self._sampler = sampler_of(
            hand.hand,
            prior,
            candidates=candidates,
            station=station,
            surroundings=surroundings.in_frame(self._X_WE.GetAsMatrix4()),
        )
        self._drawing = None if meshcat is None else Drawing(meshcat, path, self._X_WE)
        empty = Estimate(Contacts.empty(), Perception())
        self._estimate = self.DeclareAbstractInputPort("estimate", AbstractValue.Make(empty))
        self._made = MadeOnce[Estimate, GraspSearch](self._search)
        needs = {self._estimate.ticket()}
        none: tuple[float, RigidTransform] = (np.inf, RigidTransform())
        self.grasp = declare_output(self, "grasp", none, self._best, needs)
        self.plan = declare_output(self, "plan", GraspSearch((), {}, 0), self._planned, needs)
        for name in ("joint_positions", "pregrasp_positions", "squeeze_efforts"):

            def calculate(context: Context, output: object, name: str = name) -> None:
                output.SetFromVector(self._joint_values(context, name))  # type: ignore[attr-defined]

            self.DeclareVectorOutputPort(name, len(self._actuated), calculate, needs)

    def _planned(self, context: Context) -> GraspSearch:
        """Return the plan for the estimate, and draw it if it is new."""
        source = "the output 'estimate' of a SurfaceEstimator"
        search = self._made(read_port(self._estimate, context, Estimate, source))
        if self._drawing is not None:
            self._drawing.show(
                search, context.get_time(), lambda meshcat, path: self._draw(meshcat, path, search)
            )
        return search

    def _search(self, estimate: Estimate) -> GraspSearch:
        if estimate.mesh is None:
            return GraspSearch((), {}, 0)
        rng = np.random.default_rng(self._seed)
        return self._sampler.sample(
            estimate.mesh, rng=rng, support_height=self._table, count=self._count
        )

    def _best(self, context: Context) -> tuple[float, RigidTransform]:
        search = self._planned(context)
        if not len(search):
            return np.inf, RigidTransform()
        X_EG = search.best.X_OH @ inverse_pose(self._hand.X_LH)
        cost = 1.0 - float(search.best.quality["success_probability"])
        return cost, self._X_WE @ rigid(X_EG)

    def _joint_values(self, context: Context, name: str) -> FloatArray:
        """Return joint positions or efforts by actuator; 0 without a grasp."""
        search = self._planned(context)
        if not len(search):
            return np.zeros(len(self._actuated))
        grasp = search.best
        squeezes = name == "squeeze_efforts"
        values = squeeze_efforts(self._hand, grasp) if squeezes else getattr(grasp, name)
        return np.asarray(values)[self._actuated]

    def _draw(self, meshcat: Meshcat, path: str, search: GraspSearch) -> None:
        for k, grasp in enumerate(search):
            colour = Rgba(*(_OTHER if k else _BEST))
            show_hand(meshcat, f"{path}/{k}", self._hand, grasp.X_OH, grasp.joint_positions, colour)


def squeeze_efforts(hand: Hand, grasp: Grasp) -> FloatArray:
    """Return the joint efforts (J,) that press with the planned forces of a grasp: ``J^T f``."""
    q, X_OH = grasp.joint_positions, grasp.X_OH
    links, efforts = hand.forward_kinematics(X_OH, q), np.zeros(len(q))
    contacts = zip(grasp.contact_fingers, grasp.contact_points, grasp.contact_forces, strict=True)
    for finger, point, force in contacts:
        f = hand.fingers.index(finger)
        pad = hand.pads[f]
        offsets = np.zeros((len(hand.pads), 3))
        offsets[f] = apply_pose(inverse_pose(links[pad.link]), point) - pad.center_L
        _, _, jacobians, _ = hand.pad_jacobians(X_OH, q, offsets)
        efforts += jacobians[f, :, 6:].T @ force
    return efforts
