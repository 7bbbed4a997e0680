"""Timed motion of an arm for one grasp: to the grasp, and up with the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.arms.placement import home_of
from lis_grasp.arms.reach import ArmGrasp, ReachFilter
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import TIME_STEP, JointTrajectory, joined, time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.typing import FloatArray

SPEED = 0.1
"""Largest speed of the palm on the straight approach and on the lift [m/s]."""

NO_PATH = "no_collision_free_arm_path"
"""Reason of a grasp whose approach begins where the arm cannot get."""


@dataclass(frozen=True, slots=True, eq=False)
class GraspMotion:
    """Trajectories of an arm for one grasp; between them the hand closes."""

    approach: JointTrajectory  # from home to the grasp, the hand opened
    lift: JointTrajectory  # from the grasp straight up


def plan_grasp_motion(
    station: Station,
    mesh: trimesh.Trimesh | None,
    grasp: Grasp,
    *,
    rng: np.random.Generator,
) -> GraspMotion | str:
    """Return the motion for a grasp, or the reason that there is none.

    The arm goes from home to the beginning of the approach around the object, whose estimate is a
    closed mesh in W [m], then straight to the grasp in W, and from there straight up. `rng` is for
    the path around the object.
    """
    planned = plan_transit(station, mesh, grasp, rng=rng)
    if isinstance(planned, str):
        return planned
    straight, transit = planned
    approach, lift = (_straight(station, path) for path in (straight.approach, straight.lift))
    return GraspMotion(joined([transit, approach]), lift)


def plan_transit(
    station: Station,
    mesh: trimesh.Trimesh | None,
    grasp: Grasp,
    *,
    rng: np.random.Generator,
    step: float = TIME_STEP,
) -> tuple[ArmGrasp, JointTrajectory] | str:
    """Return the straight paths of a grasp, and the motion from home to where they begin.

    Or the reason that there are none. Arguments are as of `plan_grasp_motion`; the motion has a
    point each `step` [s].
    """
    q_open = grasp.pregrasp_positions
    (straight,) = ReachFilter(station, mesh).plan(
        grasp.X_OH[None], q_open[None], grasp.joint_positions[None]
    )
    if isinstance(straight, str):
        return straight
    planner = TransitPlanner(station, mesh)
    corners = planner.plan(home_of(station), straight.standoff, q_open, rng=rng)
    if corners is None:
        return NO_PATH
    return straight, time_path(
        station.arm, corners, is_free=lambda path: planner.is_free(path, q_open), step=step
    )


def _straight(station: Station, path: FloatArray) -> JointTrajectory:
    """Return the motion along a straight path of the palm (S, J), no faster than `SPEED`."""
    arm = station.arm
    fraction = arm.speed_fraction
    motion = time_path(arm, path)
    while (fastest := _palm_speed(station, motion)) > SPEED:
        fraction *= 0.98 * SPEED / fastest
        motion = time_path(arm, path, fraction=fraction)
    return motion


def _palm_speed(station: Station, motion: JointTrajectory) -> float:
    """Return the largest speed of the palm's origin [m/s]."""
    _, jacobians = station.jacobians(motion.positions)
    velocities = jacobians[:, :3] @ motion.velocities[..., None]
    return float(np.linalg.norm(velocities[..., 0], axis=1).max())
