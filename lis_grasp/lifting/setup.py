"""Setup of a simulated lift: object, hand, grasp, options, the arm's part, and control gains."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import JointTrajectory
from lis_grasp.arms.transit import plan_transit
from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.geometry import inverse_pose
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.outcome import LiftOptions, Reason
from lis_grasp.lifting.place_plan import PlacePlan
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import by_joint_kind
from lis_grasp.shapes.object_mass import GRAVITY, USUAL_FRICTION, USUAL_MASS, require_load
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

# A hand of 1 kg follows 1 g within 1 mm.
WRIST_STIFFNESS = (2e4, 3e2)
"""Of the wrist's prismatic and revolute joints [N/m, N m/rad]."""
WRIST_DAMPING = (4e2, 6.0)
"""Of the wrist's prismatic and revolute joints [N s/m, N m s/rad]."""
WRIST_LIMITS = (150.0, 15.0)
"""Largest efforts of the wrist's prismatic and revolute joints [N, N m]."""

# Inertia of a finger's small motor at the joint, with its gears [kg m^2]. Hands' files give none.
# Drake's friction creeps by its time step and by what moves at the contact: light fingers alone
# walked over an edge, off flat things that MuJoCo, and Drake in steps of 1 ms, held.
_MOTOR_INERTIA = 1e-3
# Joint error at which a finger's spring gives full effort: it yields to errors of the estimate.
_FULL_EFFORT_ERROR = {"revolute": 0.1, "prismatic": 0.01}  # [rad], [m]
_RESERVE = 3.0  # times the effort that the largest contact force needs
_DAMPING_TIME = 0.035  # [s], damping by stiffness


@dataclass(frozen=True, slots=True, eq=False)
class ArmLift:
    """The arm's part of a lift."""

    station: Station
    transit: JointTrajectory  #: from the arm's home to where the straight approach begins


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class LiftSetup:
    """A hand, its grasp, and the true, free object on a table.

    Raises
    ------
    InvalidMeshError
        If the mesh is not watertight: it has no volume to weigh.
    InvalidOptionError
        If mass or friction is out of range, or the grasp is for another hand.
    """

    mesh: trimesh.Trimesh  #: the true object in its frame O, upright [m]; watertight
    hand: Hand
    grasp: Grasp  #: in O
    support_height: float  #: height of the table's top in O [m]
    mass: float = USUAL_MASS  #: of the object [kg]
    friction: float = USUAL_FRICTION  #: Coulomb's coefficient of the object on hand and table
    options: LiftOptions = field(default_factory=LiftOptions)
    #: (4, 4), true pose of the object in the frame in which the grasp was planned
    X_WO: FloatArray = field(default_factory=lambda: np.eye(4))
    #: the arm that carries the hand, with its path to where the approach begins; None for a free
    #: wrist. It stops at a contact of its own links or when a joint needs more than its largest
    #: effort, and shakes as far as its limits allow: forces on the object make up for the rest
    arm: ArmLift | None = None
    surroundings: Surroundings = ALONE  #: the true bodies beside the object, in W
    place: PlacePlan | None = None  #: where a held object is put; None to end in the air
    #: the object as known, in W [m], by which a hand finds the pose of what it holds
    estimate: trimesh.Trimesh | None = None

    def __post_init__(self) -> None:
        if not self.mesh.is_watertight:
            raise InvalidMeshError("a lift needs a watertight mesh: load it with `shapes.load`")
        require_load(mass=self.mass, friction=self.friction)
        if tuple(self.grasp.joint_names) != tuple(self.hand.joint_names):
            raise InvalidOptionError(
                f"the grasp must be for the joints of '{self.hand.name}'; it is for those of"
                f" '{self.grasp.hand}'",
                option="grasp",
                value=self.grasp.hand,
            )

    @property
    def X_WB(self) -> FloatArray:
        """Pose of the hand's base link in the grasp, shape (4, 4)."""
        X_OH = np.asarray(self.grasp.X_OH, dtype=np.float64)
        return np.asarray(X_OH @ inverse_pose(self.hand.X_LH))

    @property
    def needed_links(self) -> int:
        """Number of links that touch a held object: two fingers, or the lip of a cup."""
        return 2 if self.hand.cup is None else 1

    @cached_property
    def slides_on_table(self) -> bool:
        """Whether fingertips are planned so near to the table that they may slide on it."""
        grasp = self.grasp
        return self.hand.slides_at(grasp.X_OH, grasp.joint_positions, self.support_height)

    @property
    def grip_friction(self) -> float:
        """Coulomb coefficient with which the grip forces are planned."""
        return self.options.assumed_friction or self.friction

    def grip_force(self, mass: float) -> float:
        """Return the wanted sum of normal forces [N] for a mass [kg]; see `LiftOptions`."""
        margin, load = self.options.grip_margin, self._load(mass)
        largest = 2.0 * self.hand.max_contact_force
        return max(
            margin * load / self.grip_friction,
            min(largest, margin * self.needed_force(mass)),
            self.options.least_grip_force,
        )

    def needed_force(self, mass: float) -> float:
        """Return the sum of normal forces [N] that just carries a mass [kg] in the largest shake.

        By Coulomb's law and by the load that the planned grasp carries per newton, if it names it:
        levers to the centre of mass and the inertia of long objects are part of that.
        """
        per_grip = self.grasp.quality.get("load_per_grip", np.inf)
        return self._load(mass) / max(min(per_grip, self.grip_friction), 1e-9)

    def _load(self, mass: float) -> float:
        """Return weight and inertia of a mass [kg] in the largest shake [N]."""
        return mass * (GRAVITY + max(self.options.shake_accelerations, default=0.0))


def finger_gains(hand: Hand, grasp: Grasp) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and damping of the joints, each (J,) [N m/rad, N m s/rad; N/m, N s/m]."""
    errors = by_joint_kind(hand, **_FULL_EFFORT_ERROR)
    stiffness = useful_efforts(hand, grasp.joint_positions) / errors
    return stiffness, _DAMPING_TIME * stiffness


def motor_inertias(hand: Hand) -> FloatArray:
    """Return the inertia of the motors at the joints (J,) [kg m^2, kg], 0 where jaws slide."""
    return by_joint_kind(hand, revolute=_MOTOR_INERTIA, prismatic=0.0)


def plan_arm_lift(
    station: Station, grasp: Grasp, estimate: trimesh.Trimesh | None, *, time_step: float
) -> ArmLift | Reason:
    """Return the arm's part of a lift, or the reason that there is none.

    The arm avoids the table and the `estimate` of the object; None for no object. Its path has a
    sample each `time_step` [s].
    """
    rng = np.random.default_rng(0)  # the same transit in equal calls
    planned = plan_transit(station, estimate, grasp, rng=rng, step=time_step)
    if isinstance(planned, str):
        return "no_arm_motion"
    _, transit = planned
    return ArmLift(station, transit)


def useful_efforts(hand: Hand, q: npt.ArrayLike) -> FloatArray:
    """Return the joints' effort limits (J,) [N m or N], without what no contact force needs.

    Files often give efforts far above the real motors'. Three times the largest contact force, at
    the longest lever of a pad about a joint of that kind, is the most that counts. Levers are taken
    at the joint positions q (J,).
    """
    _, _, jacobian, _ = hand.pad_jacobians(np.eye(4), q)  # (F, 3, 6 + J)
    levers = np.linalg.norm(jacobian[:, :, 6:], axis=1).max(axis=0)  # (J,) [m or 1]
    turning = by_joint_kind(hand, revolute=1.0, prismatic=0.0) > 0.0
    for kind in (turning, ~turning):
        levers[kind] = levers[kind].max(initial=0.0)
    return np.minimum(hand.effort_limits, _RESERVE * hand.max_contact_force * levers)
