"""A small scene: a box, six contacts, a two-finger hand, grasps and a lift."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import HandPose, Probe, ProbeOutcome
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.motion import Motion
from lis_grasp.pipeline import SILENT, RunConfig, Scenario
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import Joint, LinkGeometry, Pad
from lis_grasp.shapes import Shape
from lis_grasp.visualization import Scene
from lis_grasp.visualization.scene_server import SceneServer

HALF = 0.03


def box() -> trimesh.Trimesh:
    return trimesh.creation.box((2 * HALF, 2 * HALF, 2 * HALF))


def estimate() -> trimesh.Trimesh:
    mesh = box().subdivide().subdivide()
    mesh.vertex_attributes["uncertainty"] = 1e-3 * (1.0 + mesh.vertices[:, 2] / HALF)  # 0 to 2 mm
    return mesh


def contacts() -> Contacts:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    return Contacts(HALF * axes, axes, free_points=np.array([[0.1, 0.0, 0.0]]))


def pose(x: float, y: float, z: float) -> np.ndarray:
    X = np.eye(4)
    X[:3, 3] = x, y, z
    return X


def hand() -> Hand:
    """Return a palm above two fingers that slide along x."""
    fingers = ("left", "right")
    sides = (-1.0, 1.0)
    joints = tuple(
        Joint(f"{f}_joint", "prismatic", "palm", f, np.eye(4), np.array([s, 0.0, 0.0]), k)
        for k, (f, s) in enumerate(zip(fingers, sides, strict=True))
    )
    palm = LinkGeometry(
        "palm",
        pose(0, 0, 0.11),
        "box",
        (0.14, 0.05, 0.03),
        trimesh.creation.box((0.14, 0.05, 0.03)),
    )
    size = (0.01, 0.02, 0.1)
    bars = tuple(
        LinkGeometry(f, pose(0, 0, 0.05), "box", size, trimesh.creation.box(size)) for f in fingers
    )
    pads = tuple(
        Pad(f, f, np.zeros(3), 0.0, np.array([-s, 0.0, 0.0]), 0.3)
        for f, s in zip(fingers, sides, strict=True)
    )
    return Hand(
        name="pincers",
        kind="parallel_jaw",
        joint_names=("left_joint", "right_joint"),
        lower=np.zeros(2),
        upper=np.full(2, 0.1),
        effort_limits=np.ones(2),
        links=("palm", *fingers),
        joints=joints,
        inertials={},
        link_geometries=(palm, *bars),
        visuals=(),
        hulls_of_visuals=(),
        pads=pads,
        X_LH=np.eye(4),
        approach_H=np.array([0.0, 0.0, -1.0]),
        pregrasps={},
        probe_postures={},
        self_collision_exclusions=frozenset(),
        max_contact_force=10.0,
    )


def grasp(opening: float = HALF + 0.005) -> Grasp:
    return Grasp(
        hand="pincers",
        X_OH=np.eye(4),
        joint_names=("left_joint", "right_joint"),
        joint_positions=np.full(2, opening),
        pregrasp_positions=np.full(2, 0.06),
        approach_O=np.array([0.0, 0.0, -1.0]),
        contact_points=np.array([[-HALF, 0.0, 0.0], [HALF, 0.0, 0.0]]),
        contact_normals=np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        contact_fingers=("left", "right"),
        contact_forces=np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
        quality={"epsilon": 0.125},
        accepted="force closure",
    )


def motion(height: float = 0.1) -> Motion:
    times = np.linspace(0.0, 2.0, 201)
    lift = np.array([pose(0, 0, z) for z in height * np.clip(times - 1.0, 0.0, 1.0)])
    links = hand().forward_kinematics(lift, np.full(2, HALF + 0.005))
    return Motion(times, {"object": lift, **links})


def growth() -> tuple[tuple[int, trimesh.Trimesh], ...]:
    """Return an estimate from three contacts, a quarter of the box's volume."""
    mesh = estimate()
    mesh.vertices = mesh.vertices * [0.5, 0.5, 1.0]
    return ((3, mesh),)


def touches() -> tuple[ProbeOutcome, ...]:
    """Return one touch from above for each contact, with the open hand 1 mm above it."""
    down = np.array([0.0, 0.0, -1.0])
    made = contacts()
    return tuple(
        ProbeOutcome(
            Probe(point, down, 0.02, 0.02),
            "touched",
            made.subset([k]),
            hand_pose=HandPose(pose(*(point + [0.0, 0.0, 0.001])), np.full(2, 0.06)),
        )
        for k, point in enumerate(made.points)
    )


def scene(**changes: Any) -> Scene:
    content: dict[str, Any] = {
        "truth": box(),
        "estimate": estimate(),
        "contacts": contacts(),
        "growth": growth(),
        "touches": touches(),
        "grasps": (grasp(), grasp(0.05)),
        "hand": hand(),
        "motion": motion(),
        "support_height": -HALF,
        "title": "A box",
        "summary": ("six touches",),
    }
    return Scene(**{**content, **changes})


def scenario(shape: Shape, hand: Hand, X_EO: np.ndarray | None = None, **options: Any) -> Scenario:
    """Return the scenario of an object of 0.2 kg at a pose, with a run's options by name."""
    config = RunConfig(**{"mass": 0.2, **options})
    return Scenario.from_config(config, shape, hand, recorded={"X_EO": X_EO})


def facts_of(page: str) -> dict[str, Any]:
    """Return the values for the script of a scene's page."""
    return json.loads(re.search(r'id="scene-data">(.*?)</script>', page, re.DOTALL)[1])


@contextmanager
def served(folder: Path, **options: Any) -> Iterator[SceneServer]:
    """Serve the scene of a folder in a thread."""
    with SceneServer(folder, port=0, **options) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


class Told:
    """Progress that keeps the titles of stages and the lines."""

    def __init__(self) -> None:
        self.titles: list[str] = []
        self.lines: list[str] = []

    def stage(self, title: str) -> AbstractContextManager[Any]:
        self.titles.append(title)
        return SILENT.stage(title)

    def say(self, text: str) -> None:
        self.lines.append(text)
