"""Pads of fingertips: a sphere fitted to the closing side of each finger."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.geometry import angle_between, apply_pose, cross, rotate_back, tangent_frame, unit
from lis_grasp.records import read_only
from lis_grasp.robots.draft._flat_pads import fit_flat_pads
from lis_grasp.robots.draft._structure import DraftFinger, reach
from lis_grasp.robots.kinematics import Kinematics, link_kinematics
from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.robots.robot_model import Pad, RobotModel
from lis_grasp.typing import FloatArray

TILTS = (0.45, 0.25, 0.7, 0.0)
"""Angles of a pad's axis from the closing direction towards the end of the finger [rad]."""

_CONE = np.cos(0.9)  # directions to which the sphere is fitted
_TIP_LENGTH = 0.03  # part of a finger, from its end, to which the sphere is fitted [m]
_RADII = (0.004, 0.02)  # [m]
_PROTRUSION = 0.004  # by which the link may reach beyond the pad's sphere [m]
_HALF_ANGLES = (0.5, 1.2)  # [rad]
_PARALLEL = 0.05  # a tip does not turn if its rotation matrix changes by less


def fit_pads(
    model: RobotModel, fingers: Sequence[DraftFinger], tilts: Sequence[float] = TILTS
) -> tuple[Pad, ...]:
    """Return one pad for each finger; the flat faces of a gripper's two, else spheres.

    A finger closes as its last joint bends it towards the other fingertips in the middle of all
    joints' ranges; a tip that is kept parallel, along its motion relative to the others. `tilts`
    are angles of a pad's axis from that direction towards the end of the finger [rad], of which the
    best is taken.
    """
    if len(fingers) == 2:
        return fit_flat_pads(model, fingers)
    kinematics = link_kinematics(model)
    poses = kinematics.poses(np.eye(4), 0.5 * (model.lower + model.upper))
    middles_B = np.array([apply_pose(poses[f.link], f.points_L.mean(axis=0)) for f in fingers])
    slides_B = _slides(model, fingers, kinematics)
    pads = []
    for i, finger in enumerate(fingers):
        X_BL = poses[finger.link]
        others_B = np.delete(middles_B, i, axis=0).mean(axis=0)
        towards_L = unit(rotate_back(X_BL, others_B - middles_B[i]))
        if i in slides_B:
            arm_L = rotate_back(X_BL, middles_B[i] - poses[model.links[0]][:3, 3])
            slide_L = rotate_back(X_BL, slides_B[i])
            closing_L = slide_L * (np.sign(slide_L @ towards_L) or 1.0)
            pads.append(round_pad(finger, closing_L, _across(arm_L, closing_L), (0.0,)))
        else:
            pads.append(round_pad(finger, *_closing(finger, towards_L), tilts))
    return tuple(pads)


def _slides(
    model: RobotModel, fingers: Sequence[DraftFinger], kinematics: Kinematics
) -> dict[int, FloatArray]:
    """Return by finger the direction (3,) in which tips move without turning, relative to others.

    Bars and joints that follow a motor keep such tips parallel, so that the last joint's axis does
    not say how they close.
    """
    paths = {}  # displacements of tips that do not turn
    for i, finger in enumerate(fingers):
        if not finger.joint.follows or len(finger.motors) != 1:
            continue
        q = np.tile(0.5 * (model.lower + model.upper), (2, 1))
        (motor,) = finger.motors
        q[:, motor] = model.lower[motor], model.upper[motor]
        X = kinematics.poses(np.broadcast_to(np.eye(4), (2, 4, 4)), q)[finger.link]
        if np.linalg.norm(X[1, :3, :3] - X[0, :3, :3]) <= _PARALLEL:
            low, high = apply_pose(X, finger.points_L.mean(axis=0))
            paths[i] = high - low
    slides = {}
    for i, path in paths.items():
        rivals = [other for j, other in paths.items() if j != i]
        relative = path - np.mean(rivals, axis=0) if rivals else path
        if relative.any():
            slides[i] = unit(relative)
    return slides


def _across(arm: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the part (3,) of an arm [m] across an axis, unit; of a shorter one any direction."""
    across = arm - (arm @ axis) * axis
    length = float(np.linalg.norm(across))
    return across / length if length > 1e-4 else tangent_frame(axis)[0]


def _closing(finger: DraftFinger, towards_L: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors in the link frame: the tip's motion when closing, and its far end."""
    joint = finger.joint
    if joint.kind == "prismatic":
        axis = finger.axis_L
        sign = np.sign(axis @ towards_L) or 1.0
        return sign * axis, _across(finger.points_L.mean(axis=0) - finger.origin_L, axis)
    outward = unit(reach(finger.points_L, finger.origin_L, finger.axis_L))
    motion = cross(finger.axis_L, outward)
    sign = np.sign(motion @ towards_L) or 1.0
    return sign * motion, outward


def round_pad(
    finger: DraftFinger,
    closing_L: FloatArray,
    outward_L: FloatArray,
    tilts: Sequence[float] = TILTS,
) -> Pad:
    """Return the sphere whose support function fits the finger's end best.

    A sphere has the support function ``u @ center + radius``, so that the fit over directions u in
    a cone about the pad's axis is linear. Its radius is at most half the
    width of the finger. The half angle is the largest within which the whole link reaches at most
    4 mm beyond the sphere; of axes that fit equally, to 0.1 mm, the one with the widest cone.
    """
    along = finger.points_L @ outward_L
    end = finger.points_L[along >= along.max() - _TIP_LENGTH]
    lattice = fibonacci_directions(600)
    width = float(np.ptp(end @ cross(closing_L, outward_L)))
    largest = float(np.clip(0.5 * width, *_RADII))
    fits = []
    for tilt in tilts:
        axis = np.cos(tilt) * closing_L + np.sin(tilt) * outward_L
        cone = lattice[lattice @ axis >= _CONE]
        support = (end @ cone.T).max(axis=0)
        columns = np.column_stack([cone, np.ones(len(cone))])
        solution = np.linalg.lstsq(columns, support, rcond=None)[0]
        radius = float(np.clip(solution[3], _RADII[0], largest))
        center = np.linalg.lstsq(cone, support - radius, rcond=None)[0]
        # The sphere touches the face at the middle of the pad exactly.
        center = center + ((end @ axis).max() - radius - center @ axis) * axis
        error = float(np.sqrt(np.mean((support - cone @ center - radius) ** 2)))
        # What is behind the finger's end should not be farther out.
        error += float((finger.points_L @ axis).max() - (end @ axis).max())
        beyond = (finger.points_L @ lattice.T).max(axis=0) - lattice @ center - radius
        reached = angle_between(lattice, axis)[beyond > _PROTRUSION]
        half_angle = float(np.clip(reached.min(initial=np.pi), *_HALF_ANGLES))
        fits.append((error, axis, center, radius, half_angle))
    _, axis, center, radius, half_angle = min(fits, key=lambda fit: (round(fit[0], 4), -fit[4]))
    center, axis = read_only(np.array(center)), read_only(unit(axis))
    return Pad(finger.name, finger.link, center, radius, axis, half_angle)
