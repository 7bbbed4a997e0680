"""Schema of an arm's YAML file, as pydantic models."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from lis_grasp.robots.hand_schema import Name, Number, Positive, Vector


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class FlangePose(_Entry):
    """Pose of the flange frame F in the flange link, +z out of the flange."""

    translation: Vector = Field(default=[0.0, 0.0, 0.0], description="[m]")
    rpy: Vector = Field(default=[0.0, 0.0, 0.0], description="Fixed-axis roll, pitch, yaw [rad].")


class ArmEntry(_Entry):
    """An arm's YAML file; what is left out comes from the URDF or SDF."""

    name: Name
    urdf: Name = Field(description="URDF or SDF file: a path from this file, or package://NAME/...")
    model_from: str = Field(
        default="", description="How to get the URDF or SDF, for the message when it is missing."
    )
    flange: Name = Field(description="Link that carries the hand; links beyond it are left out.")
    flange_pose: FlangePose | None = Field(
        default=None, description="Flange frame in that link; by its bodies if left out."
    )
    base_link: Name | None = Field(
        default=None, description="Root of the arm, on its base: links before it are left out."
    )
    joints: list[Name] | None = Field(
        default=None, description="Movable joints from base to flange, to check the file's."
    )
    locked_joints: dict[Name, Number] = Field(
        default_factory=dict, description="Joints that do not move, at these positions [rad or m]."
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
    effort_limits: dict[Name, Positive] = Field(
        default_factory=dict, description="Instead of the file's, by joint [N m or N]."
    )
    stiffness: list[Positive] | None = Field(
        default=None, description="Of the joint control [N m/rad or N/m], one number a joint."
    )
    speed_fraction: float = Field(
        default=0.5, gt=0.0, le=1.0, description="Of the velocity and acceleration limits, used."
    )
    repair: bool = Field(
        default=False,
        description="Replace impossible inertias and missing masses by those of the link's bodies.",
    )
    self_collision_exclusions: list[Annotated[list[Name], Field(min_length=2, max_length=2)]] = (
        Field(
            default_factory=list,
            description="Pairs of links that may touch, besides those found by sampling.",
        )
    )
