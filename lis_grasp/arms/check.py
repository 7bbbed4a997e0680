"""Checks of an arm with a hand: limits, flange, mount, home, reach, and efforts under gravity."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.mounted_hand import CLEARANCE, mount_of
from lis_grasp.arms.placement import choose_base, home_of, palm_targets, reach_fraction
from lis_grasp.arms.station import Station
from lis_grasp.exceptions import LisGraspError
from lis_grasp.exploration.region import DEFAULT_REGION
from lis_grasp.geometry import apply_pose, cross, inverse_pose, rotate
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.arm_defaults import BEYOND
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import Finding, body_findings
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import FloatArray

OBJECT_MASS = 0.5
"""Mass that the arm is to carry [kg]."""

_ENOUGH = 0.4  # fraction of the region that must be reached
# A joint's speed is plausible from 0.005 to 20 rad/s or m/s.
_SLOWEST, _FASTEST = 0.005, 20.0
_ROUNDING = 1e-6  # of a length [m]


def check_arm(arm: Arm, hand: Hand) -> list[Finding]:
    """Return the findings on an arm with a hand, in the order in which to fix failures.

    The base is chosen for its reach.
    """
    findings = [*_masses(arm), *_limits(arm), *_flange(arm)]
    try:
        mount = mount_of(arm, hand)
    except LisGraspError as error:
        return [*findings, Finding(False, str(error))]
    spacer = f" with an adapter of {1e3 * mount.adapter:g} mm" if mount.adapter else ""
    origin = "its own mount" if hand.X_FB is not None else f"its back on the flange{spacer}"
    findings.append(
        Finding(
            True,
            f"hand {hand.name} has {origin}, more than {1e3 * CLEARANCE:g} mm from the last links",
        )
    )
    try:
        station = choose_base(arm, hand)
    except LisGraspError as error:
        return [*findings, Finding(False, str(error))]
    findings += _home(station)
    findings += _reach(station)
    return [*findings, *_efforts(station)]


def _masses(arm: Arm) -> Iterator[Finding]:
    yield from body_findings(arm)
    fine = 0.1 <= arm.mass <= 500.0
    advice = "" if fine else ": masses must be in kg, 0.1 to 500 in all"
    joints = len(arm.joint_names)
    yield Finding(fine, f"arm {arm.name}: {joints} joints, moving mass {arm.mass:.1f} kg{advice}")


def _limits(arm: Arm) -> Iterator[Finding]:
    slow = [
        f"{name} {speed:g}"
        for name, speed in zip(arm.joint_names, arm.velocity_limits, strict=True)
        if not _SLOWEST <= speed <= _FASTEST
    ]
    if slow:
        yield Finding(
            False,
            f"speed limits must be {_SLOWEST:g} to {_FASTEST:g} rad/s; check {', '.join(slow)}, or"
            " give velocity_limits in the YAML",
        )
    if len(arm.joint_names) < 6:
        yield Finding(
            True, f"with {len(arm.joint_names)} joints it reaches few directions at each place"
        )


def _flange(arm: Arm) -> Iterator[Finding]:
    """Compare the flange's +z with where the bodies of the last link are."""
    links = arm.forward_kinematics(np.eye(4), arm.home)
    X_FA = inverse_pose(links[arm.flange] @ arm.X_LF)
    beyond = 0.0
    for geometry in arm.link_geometries:
        if geometry.link in arm.flange_links:
            X_FG = X_FA @ links[geometry.link] @ geometry.X_LG
            heights = np.asarray(geometry.mesh.vertices) @ X_FG[2, :3] + X_FG[2, 3]
            beyond = max(beyond, float(heights.max()))
    if not np.array_equal(arm.X_LF, np.eye(4)):
        place = ", ".join(f"{1e3 * x:.0f}" for x in arm.X_LF[:3, 3])
        axis = ", ".join(f"{x:.2g}" for x in arm.X_LF[:3, 2])
        yield Finding(
            True,
            f"the flange is at ({place}) mm in the frame of {arm.flange}, and points along"
            f" ({axis}); flange_pose in the YAML changes it",
        )
    if beyond > BEYOND + _ROUNDING:
        yield Finding(
            False,
            f"the last link is up to {1e3 * beyond:.0f} mm beyond the flange frame: its +z must"
            " point out of the flange; name another link as flange, or turn it by flange_pose",
        )


def _home(station: Station) -> Iterator[Finding]:
    arm = station.arm
    try:
        home = home_of(station)
    except LisGraspError as error:
        yield Finding(False, str(error))
        return
    if home is arm.home:
        yield Finding(True, "at home the hand is above the table and free in all its postures")
        return
    posture = next(iter(station.hand.pregrasps.values()))
    hit = StationChecker(station).first_hit(arm.home, posture)
    why = "the hand is too low" if hit is None else f"{hit[1]} meets the {hit[0]}"
    shown = ", ".join(f"{x:.2f}" for x in home)
    yield Finding(True, f"at the arm's own home {why}, so another is used: [{shown}]")


def _reach(station: Station) -> Iterator[Finding]:
    fraction = reach_fraction(station)
    place = ", ".join(f"{x:.2f}" for x in station.X_WA[:3, 3])
    size = " x ".join(f"{100 * side:g}" for side in DEFAULT_REGION)
    text = (
        f"from its base at ({place}) the hand reaches {100 * fraction:.0f} % of places and"
        f" directions of {size} cm on the table"
    )
    advice = ": turn the hand on the flange (mount in its YAML), or move the base"
    yield Finding(fraction >= _ENOUGH, text if fraction >= _ENOUGH else text + advice)


def _efforts(station: Station) -> Iterator[Finding]:
    arm = station.arm
    targets = palm_targets(station.hand, np.zeros(3), DEFAULT_REGION, each=3)[:, 0]
    solutions = station.solve_ik(targets, seeds=4, first=arm.home)
    q = solutions.q[solutions.solved]
    used = np.abs(gravity_efforts(station, q, load=OBJECT_MASS)) / arm.effort_limits
    if not len(used):
        return
    worst = used.max(axis=0)
    j = int(np.argmax(worst))
    fine = worst[j] <= 1.0
    text = (
        f"gravity uses up to {100 * worst[j]:.0f} % of the effort limits ({arm.joint_names[j]}),"
        f" with the hand of {station.hand.mass:.2f} kg and an object of {OBJECT_MASS:g} kg"
    )
    advice = ": the load is too heavy, or effort_limits or masses are wrong"
    yield Finding(fine, text if fine else text + advice)


def gravity_efforts(station: Station, q: FloatArray, *, load: float = 0.0) -> FloatArray:
    """Return the efforts that hold arm, hand and a load against gravity, (N, J) [N m or N].

    The effort of joint j is ``sum_i m_i g dz_i/dq_j`` over the masses that it moves, whose centres
    rise by dz_i. The load [kg] is at the middle of the hand's pads; the arm is at q (N, J).
    """
    hand = station.hand
    posture = next(iter(hand.pregrasps.values()))
    in_hand = hand.forward_kinematics(np.eye(4), posture)
    carried = [
        (i.mass, apply_pose(in_hand[link], i.center_L)) for link, i in hand.inertials.items()
    ]
    carried.append((load, hand.pad_centers(np.eye(4), posture).mean(axis=0)))
    X_WH = station.palm_poses(q)
    links = station.arm.forward_kinematics(station.X_WA, q)
    last = len(station.arm.joint_names)
    bodies = [(mass, last, apply_pose(X_WH, p)) for mass, p in carried]
    bodies += [
        (inertial.mass, order, apply_pose(links[link], inertial.center_L))
        for link, inertial in station.arm.inertials.items()
        for order in [station.arm.joints_before[link]]
    ]
    origins, axes, turns = station.arm.kinematics.axes(q)  # (N, J, 3), (J,)
    origins, axes = apply_pose(station.X_WA, origins), rotate(station.X_WA, axes)
    efforts = np.zeros(q.shape)
    for mass, order, place in bodies:
        lever = cross(axes, place[:, None] - origins)[..., 2]
        rise = np.where(turns, lever, axes[..., 2])  # (N, J)
        efforts[:, :order] += GRAVITY * mass * rise[:, :order]
    return efforts
