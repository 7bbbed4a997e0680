"""Schemas of the YAML files of hands and arms, as pydantic models."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from lis_grasp.robots.robot_model import GraspFamily, HandKind

FEW_DIGITS = 1e-4
"""Error of a number that is written with few digits [rad or m]."""

UNLIMITED = 1e6
"""No length, angle, force or mass of a robot is larger [m, rad, N, kg]; a limit of it is none."""

ATMOSPHERE = 101_325.0
"""Pressure of the air at sea level, the largest difference that a vacuum makes [Pa]."""


def _not_zero(vector: list[float]) -> list[float]:
    if np.linalg.norm(vector) < np.finfo(np.float64).eps:  # squares below 1e-308 are zero
        raise ValueError("must not be zero")
    return vector


def _in_radians(angles: list[float]) -> list[float]:
    # Nobody writes more than a whole turn, but degrees.
    most = max(map(abs, angles))
    if most > 2.0 * np.pi:
        raise ValueError(
            f"must be angles in rad, of one turn at most; {most:g} is more: if they are degrees,"
            f" multiply them by pi/180 = {np.pi / 180.0:.6f}"
        )
    return angles


Name = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(ge=-UNLIMITED, le=UNLIMITED)]
Positive = Annotated[float, Field(gt=0.0, le=UNLIMITED)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Direction = Annotated[Vector, AfterValidator(_not_zero)]
Angles = Annotated[Vector, AfterValidator(_in_radians)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)


class PalmFrame(_Record):
    """Pose of the palm frame H in the base link's frame."""

    translation: Vector = Field(description="[m]")
    rpy: Angles = Field(description="Fixed-axis roll, pitch, yaw, as in a URDF [rad].")


class MountEntry(_Record):
    """Pose of the base link in the flange frame F of an arm, +z out of the flange."""

    translation: Vector = Field(description="[m]")
    rpy: Angles = Field(default=[0.0, 0.0, 0.0], description="Fixed-axis roll, pitch, yaw [rad].")


class PadEntry(_Record):
    """The part of a finger that is meant to touch."""

    link: Name = Field(description="The link that carries the pad.")
    center: Vector = Field(description="Centre of the sphere or the flat face, in the link [m].")
    radius: float = Field(ge=0.0, le=UNLIMITED, description="Of the sphere [m]; 0: a flat face.")
    axis: Direction = Field(description="Outward direction at the middle of the pad, in the link.")
    half_angle: float = Field(
        gt=0.0, le=np.pi, description="The pad covers directions within this angle of axis [rad]."
    )


class CupEntry(_Record):
    """A suction cup."""

    link: Name = Field(description="The link that carries the lip.")
    center: Vector = Field(description="Centre of the lip's circle, in the link [m].")
    axis: Direction = Field(description="Outward direction of the cup, in the link.")
    radius: Positive = Field(description="Of the lip [m].")
    travel: Positive = Field(
        description="Of the lip along the axis, until it lies on a surface [m]."
    )
    tilt: float = Field(
        gt=0.0, le=0.5 * np.pi, description="Largest, of the lip, until it lies on a surface [rad]."
    )
    vacuum: float = Field(
        gt=0.0, le=ATMOSPHERE, description="Largest pressure below that of the air [Pa]."
    )


class TipEntry(_Record):
    """The sphere that touches in a probe posture."""

    link: Name = Field(description="The link that carries the sphere.")
    center: Vector = Field(description="In the link [m].")
    radius: Positive = Field(description="[m]")


class ProbeEntry(_Record):
    """A posture in which one fingertip is ahead of the rest of the hand."""

    positions: list[Number] = Field(description="One for each joint [rad or m].")
    direction: Direction = Field(description="In H: the motion of the hand towards the object.")
    tip: TipEntry


class _RobotEntry(_Record):
    """What the YAML files of hands and arms have in common."""

    name: Name
    urdf: Name = Field(
        description="URDF, SDF or MJCF: a path from this file, or package://NAME/..."
    )
    model_from: str = Field(
        default="", description="How to get that file, for the message when it is missing."
    )
    xacro_args: dict[Name, str | int | float] = Field(
        default_factory=dict, description="Arguments of that file, if it is a xacro file."
    )
    base_link: Name | None = Field(
        default=None, description="Root of the hand or arm: links before it are left out."
    )
    locked_joints: dict[Name, Number] = Field(
        default_factory=dict, description="Joints that do not move, at these positions [rad or m]."
    )
    effort_limits: dict[Name, Positive] = Field(
        default_factory=dict, description="Instead of the file's, by joint [N m or N]."
    )
    repair: bool = Field(
        default=False,
        description="Replace impossible inertias and missing masses by those of the link's bodies.",
    )
    self_collision_exclusions: list[Annotated[list[Name], Field(min_length=2, max_length=2)]] = (
        Field(
            default_factory=list,
            description="Pairs of links that may touch, besides those that one joint joins.",
        )
    )


class HandEntry(_RobotEntry):
    """A hand's YAML file."""

    kind: HandKind = Field(
        description="parallel_jaw: flat parallel pads; multi_finger: rounded pads;"
        " suction_cup: one cup instead of pads."
    )
    convex_parts: list[Name] = Field(
        default_factory=list,
        description="Links whose meshes collide as several convex parts, not as one convex hull.",
    )
    joints: list[Name] = Field(
        description="Movable joints that mimic no other, in the URDF's order."
    )
    palm_frame: PalmFrame
    approach: Direction = Field(description="In H: the motion of the hand towards an object.")
    max_contact_force: Positive = Field(description="Of one finger [N].")
    pads: dict[Name, PadEntry] = Field(
        default_factory=dict, min_length=2, description="By the finger's name."
    )
    cups: dict[Name, CupEntry] = Field(
        default_factory=dict,
        min_length=1,
        max_length=1,
        description="The suction cup, by its name.",
    )
    pregrasps: dict[Name, list[Number]] = Field(
        min_length=1, description="Opened postures by name: one number for each joint [rad or m]."
    )
    low_objects: Name | None = Field(
        default=None,
        description="File of the same hand with narrower pads, for objects lower than round pads.",
    )
    families: list[GraspFamily] | None = Field(
        default=None,
        description="Kinds of grasps that the hand can do, pinch always; by default pinch and rim,"
        " table if its fingertips are rounded, flat_faces with low_objects.",
    )
    probe_postures: dict[Name, ProbeEntry] = Field(
        default_factory=dict,
        description="By the name of the leading finger; none if the hand does not touch.",
    )
    mount: MountEntry | None = Field(
        default=None,
        description="Pose of the base link on an arm's flange; by default the back is on it.",
    )


class FlangePose(_Record):
    """Pose of the flange frame F in the flange link, +z out of the flange."""

    translation: Vector = Field(default=[0.0, 0.0, 0.0], description="[m]")
    rpy: Angles = Field(default=[0.0, 0.0, 0.0], description="Fixed-axis roll, pitch, yaw [rad].")


class ArmEntry(_RobotEntry):
    """An arm's YAML file; what is left out comes from the URDF, SDF or MJCF."""

    flange: Name = Field(description="Link that carries the hand; links beyond it are left out.")
    flange_pose: FlangePose | None = Field(
        default=None, description="Flange frame in that link; by its bodies if left out."
    )
    joints: list[Name] | None = Field(
        default=None, description="Movable joints from base to flange, to check the file's."
    )
    home: list[Number] | None = Field(
        default=None, description="Posture above the table, one number a joint; found if left out."
    )
    position_limits: dict[Name, Annotated[list[Number], Field(min_length=2, max_length=2)]] = Field(
        default_factory=dict, description="Lower and upper, instead of the file's, by joint."
    )
    velocity_limits: dict[Name, Positive] = Field(
        default_factory=dict, description="Instead of the file's, by joint [rad/s or m/s]."
    )
    acceleration_limits: dict[Name, Positive] = Field(
        default_factory=dict, description="Instead of the file's, by joint [rad/s^2 or m/s^2]."
    )
    stiffness: list[Positive] | None = Field(
        default=None, description="Of the joint control [N m/rad or N/m], one number a joint."
    )
    speed_fraction: float = Field(
        default=0.5, gt=0.0, le=1.0, description="Of the velocity and acceleration limits, used."
    )
