"""Pads of a gripper: flat faces of two fingers, chosen where they are opposite to each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.geometry import (
    angle_between,
    apply_inverse,
    apply_pose,
    hull_crossing,
    rotate,
    rotate_back,
    unit,
)
from lis_grasp.records import read_only
from lis_grasp.robots.draft._structure import DraftFinger, FingerBody, link_points
from lis_grasp.robots.kinematics import link_kinematics
from lis_grasp.robots.robot_model import Pad, RobotModel
from lis_grasp.typing import FloatArray

# Half angles of pads [rad]; if a gripper's faces turn, they must be about parallel when they touch.
_HALF_ANGLE, _TURNING_HALF_ANGLE = 0.3, 0.15
# Half angle of a fixed jaw, which is laid flat on the object [rad].
_FIXED_HALF_ANGLE = 0.05
# Between the line of two pads and their axes, where a jaw is parallel to a fixed one [rad]: beyond
# it they are moved to be opposite there.
_ASLANT = 0.19
_FLAT = 0.1  # angle over a face [rad]
_OBLIQUE = 0.12  # angle to the closing direction at which a face's area counts 1/e [rad]
_STEPS = 41  # postures of the motion from one end of all ranges to the other
_COVERED = 0.0003  # by which another body may be in front of a face [m]
_RECESSED = 0.002  # by which a body nearer to the finger's end may be in front of a face [m]
_TIP_LENGTH = 0.04  # part of a finger, from its end, that counts as its tip [m]


def fit_flat_pads(model: RobotModel, fingers: Sequence[DraftFinger]) -> tuple[Pad, ...]:
    """Return the pads of a gripper's two fingers.

    The fingers close along the gap between the tips. The pad of each is the largest flat face that
    looks about along it in the middle of all ranges.
    """
    poses, towards, outwards = _ways(model, fingers)
    pads = [flat_pad(*each) for each in zip(fingers, towards, outwards, strict=True)]
    path = np.linspace(model.lower, model.upper, _STEPS)
    along = _poses(model, path)
    faces = [rotate(along[pad.link], pad.axis_L) for pad in pads]
    turned = angle_between(-faces[0], faces[1])  # (S,)
    if any(not finger.motors for finger in fingers):  # the wrist lays the fixed jaw flat
        parallel = _poses(model, path[np.argmin(turned)])
        first, second = _opposed(pads, poses)
        ends = [apply_pose(parallel[pad.link], pad.center_L) for pad in (first, second)]
        line = unit(ends[1] - ends[0])
        if line @ rotate(parallel[first.link], first.axis_L) < np.cos(_ASLANT):
            poses = parallel
        angles = [_TURNING_HALF_ANGLE if finger.motors else _FIXED_HALF_ANGLE for finger in fingers]
    else:
        angles = [_TURNING_HALF_ANGLE if np.ptp(turned) > _FLAT else _HALF_ANGLE] * 2
    pads = _opposed(pads, poses)
    return tuple(replace(p, half_angle=angle) for p, angle in zip(pads, angles, strict=True))


def face_areas(model: RobotModel, fingers: Sequence[DraftFinger]) -> FloatArray:
    """Return the area of the flat face that each of a gripper's fingers closes with, (2,) [m^2].

    An area counts less the more its face is oblique to the closing direction; 0 without a face.
    """
    _, towards, outwards = _ways(model, fingers)
    faces = [_largest_face(*each) for each in zip(fingers, towards, outwards, strict=True)]
    return np.array([0.0 if face is None else face[0] for face in faces])


def _poses(model: RobotModel, q: FloatArray) -> dict[str, FloatArray]:
    """Return the poses of all links in the base link, for joint positions (..., J)."""
    return link_kinematics(model).poses(np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4)), q)


def _ways(
    model: RobotModel, fingers: Sequence[DraftFinger]
) -> tuple[dict[str, FloatArray], list[FloatArray], list[FloatArray]]:
    """Return the links' poses half open; each tip's ways to the other one and outwards.

    The ways are unit vectors (3,) in the frames of the tips' links.
    """
    poses = _poses(model, 0.5 * (model.lower + model.upper))
    links = [poses[finger.link] for finger in fingers]
    p_B = [apply_pose(X, f.points_L) for X, f in zip(links, fingers, strict=True)]
    palm = link_points(model).get(model.links[0], np.zeros((1, 3)))
    outward = np.mean([p.mean(axis=0) for p in p_B], axis=0) - palm.mean(axis=0)
    outward = unit(outward, least=1e-9)
    ends = [p @ outward for p in p_B]
    first, second = (
        p[end > end.max() - _TIP_LENGTH].mean(axis=0) for p, end in zip(p_B, ends, strict=True)
    )
    if not (second - first).any():
        names = " and ".join(finger.link for finger in fingers)
        raise InvalidHandError(f"the fingertips {names} are at one place, so that nothing fits in")
    closing = unit(second - first)
    towards = [rotate_back(X, s * closing) for X, s in zip(links, (1.0, -1.0), strict=True)]
    return poses, towards, [rotate_back(X, outward) for X in links]


def _opposed(pads: Sequence[Pad], poses: Mapping[str, FloatArray]) -> list[Pad]:
    """Move two flat pads along their faces until they are opposite to each other."""
    links = [poses[pad.link] for pad in pads]
    axes = [rotate(X, pad.axis_L) for X, pad in zip(links, pads, strict=True)]
    axis = unit(axes[0] - axes[1])
    offset = apply_pose(links[1], pads[1].center_L) - apply_pose(links[0], pads[0].center_L)
    across = offset - (offset @ axis) * axis
    moved = []
    for pad, X, sign in zip(pads, links, (1.0, -1.0), strict=True):
        shift = rotate_back(X, sign * 0.5 * across)
        shift = shift - (shift @ pad.axis_L) * pad.axis_L
        moved.append(replace(pad, center_L=read_only(pad.center_L + shift)))
    return moved


def flat_pad(finger: DraftFinger, towards_L: FloatArray, outward_L: FloatArray) -> Pad:
    """Return a gripper finger's largest flat face that looks about along the closing direction.

    It is a face of one body that no other body of the finger covers, nor protrudes over towards the
    finger's end, if there is one: what is held meets the foremost face at the end first.
    """
    found = _largest_face(finger, towards_L, outward_L)
    body, axis, center = (
        found[1:] if found else (finger.bodies[0], towards_L, finger.points_L.mean(axis=0))
    )
    p_L = body.points_L if found else finger.points_L
    center = center + ((p_L @ axis).max() - center @ axis) * axis
    return Pad(
        finger.name,
        body.link,
        read_only(apply_inverse(body.X_LB, center)),
        0.0,
        read_only(rotate_back(body.X_LB, axis)),
        _HALF_ANGLE,
    )


def _largest_face(
    finger: DraftFinger, towards_L: FloatArray, outward_L: FloatArray
) -> tuple[float, FingerBody, FloatArray, FloatArray] | None:
    """Return the weighted area, body, normal and middle of a finger's largest uncovered face."""
    found: list[tuple[bool, float, FingerBody, FloatArray, FloatArray]] = []
    for body in finger.bodies:
        others = [other.points_L for other in finger.bodies if other is not body]
        hulls = [ConvexHull(p_L) for p_L in others]
        for area, axis, center in _faces(body.points_L, towards_L):
            ways = (hull_crossing(hull.equations, center, axis) for hull in hulls)
            if not any(enters < leaves > _COVERED for enters, leaves in ways):
                recessed = any(_protrudes(p_L, axis, center, outward_L) for p_L in others)
                found.append((not recessed, area, body, axis, center))
    best = max(found, key=lambda face: face[:2], default=None)
    return best and best[1:]


def _protrudes(
    p_L: FloatArray, axis: FloatArray, center: FloatArray, outward_L: FloatArray
) -> bool:
    """Return whether a body is mainly beyond a face's middle outwards, and in front of the face."""
    beyond = (p_L.mean(axis=0) - center) @ outward_L > 0.0
    return bool(beyond and ((p_L - center) @ axis).max() > _RECESSED)


def _faces(
    p_L: FloatArray, towards_L: FloatArray
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Yield about flat faces of a convex hull: weighted area, normal, middle."""
    hull = ConvexHull(p_L)
    normals = hull.equations[:, :3]
    corners = p_L[hull.simplices]  # (T, 3, 3)
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    for normal in normals[normals @ towards_L > 0.0]:
        face = normals @ normal > np.cos(_FLAT)
        if areas[face].sum() > 0.0:
            middle = (areas[face] / areas[face].sum()) @ corners[face].mean(axis=1)
            weight = np.exp(-((angle_between(normal, towards_L) / _OBLIQUE) ** 2))
            yield float(areas[face].sum() * weight), normal, middle
