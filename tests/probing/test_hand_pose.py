"""The hand pose that a prober records is the one at which the reported links touch."""

import numpy as np
import pytest
import trimesh

from lis_grasp.exploration import Probe, ProbeOutcome, Prober
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.simulation.drake.object_plant import FreeObject

SIZE = 0.1


def distances_to_links(hand: Hand, outcome: ProbeOutcome) -> list[float]:
    """Return the distance [m] of each contact from the surface of the link that made it."""
    links = hand.forward_kinematics(outcome.hand_pose.X_OH, outcome.hand_pose.joint_positions)
    distances = []
    for point, link in zip(outcome.contacts.points, outcome.contacts.fingers, strict=True):
        geometries = [g for g in hand.link_geometries if g.link == link]
        meshes = [g.mesh.copy().apply_transform(links[link] @ g.X_LG) for g in geometries]
        distances.append(
            min(trimesh.proximity.closest_point(mesh, point[None])[1][0] for mesh in meshes)
        )
    return distances


def prober_of(kind: str, hand: Hand, mesh: trimesh.Trimesh) -> Prober:
    match kind:
        case "kinematic, one finger":
            return KinematicProber(hand, mesh)
        case "kinematic, all fingers":
            return KinematicProber(hand, mesh, fingers="all")
        case "dynamic, held object":
            return DynamicProber(hand, mesh)
        case _:
            return DynamicProber(hand, mesh, free=FreeObject(-0.5 * SIZE, mass=0.3))


@pytest.mark.by_default("kinematic, one finger-barrett", "dynamic, held object-barrett")
@pytest.mark.parametrize("name", [pytest.param("allegro", marks=pytest.mark.slow), "barrett"])
@pytest.mark.parametrize(
    "kind",
    [
        "kinematic, one finger",
        "kinematic, all fingers",
        "dynamic, held object",
        "dynamic, free object",
    ],
)
def test_the_recorded_pose_puts_the_touching_link_at_the_contact(kind: str, name: str) -> None:
    hand, mesh = Hand.load(name), trimesh.creation.box([SIZE] * 3)
    prober = prober_of(kind, hand, mesh)
    for direction in ([-1.0, 0.0, 0.0], [0.3, 0.8, -0.2], [0.0, 0.0, -1.0]):
        target = -0.5 * SIZE * np.sign(direction) * (np.abs(direction) > 0.5)
        outcome = prober.probe(Probe(target, direction, 0.05, 0.02))
        assert outcome.status == "touched"
        # A simulated skin is pressed in by 0.2 N, a third of a millimetre. The link's mesh is
        # faceted. A contact on a flat face is off the round tip by the patch's radius squared.
        assert max(distances_to_links(hand, outcome)) < 1e-3


def test_a_probe_without_a_touch_records_no_pose() -> None:
    prober = KinematicProber(Hand.load("allegro"), trimesh.creation.box([SIZE] * 3))
    outcome = prober.probe(Probe([0.2, 0.0, 0.0], [0.0, 0.0, -1.0], 0.05, 0.02))
    assert outcome.status == "missed"
    assert outcome.hand_pose is None
