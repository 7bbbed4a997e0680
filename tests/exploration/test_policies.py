"""Which target each policy takes, and on whose surface it is sought."""

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    POLICIES,
    Exploration,
    Probe,
    ProbeOutcome,
    TargetPolicy,
    Workspace,
    choices,
    explore,
)
from lis_grasp.exploration.targets import Targets
from lis_grasp.hands.hand import Hand
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.surfaces import ESTIMATORS

RADIUS = 0.05
NEAREST = np.array([0.01, 0.03, 0.05, 0.02, 0.04])
SECONDS = np.array([1.0, 1.0, 3.0, 1.0, 1.5])


class Ball:
    """A ball round the origin, the less known the higher."""

    def __init__(self, radius: float = RADIUS) -> None:
        self.radius = radius
        self.bounds = np.array([[-0.06] * 3, [0.06] * 3])

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=-1) - self.radius

    def gradient(self, points: np.ndarray) -> np.ndarray:
        return points / np.linalg.norm(points, axis=-1, keepdims=True)

    def uncertainty(self, points: np.ndarray) -> np.ndarray:
        return 0.1 + points[..., 2]


def targets(new: list[bool]) -> Targets:
    points = np.array([[0.0, 0.0, z] for z in (0.05, 0.01, 0.02, 0.04, 0.03)])
    return Targets(points, points / 0.05, NEAREST, NEAREST, NEAREST, np.array(new), 0.02, SECONDS)


def chosen(choice: choices.Choice, new: list[bool], seed: int = 0) -> int | None:
    return choice(targets(new), Ball(), rng=np.random.default_rng(seed))


def test_spreading_takes_the_largest_gap_that_is_new() -> None:
    assert chosen(choices.spread, [True] * 5) == 2
    assert chosen(choices.spread, [True, True, False, True, True]) == 4


def test_being_swift_takes_the_largest_gap_squared_per_second() -> None:
    assert chosen(choices.swift, [True] * 5) == 4  # 11 cm^2 / s, of 1, 9, 8 and 4
    assert chosen(choices.swift, [True, True, True, True, False]) == 1


def test_uncertainty_takes_what_is_least_known() -> None:
    assert chosen(choices.most_uncertain, [True] * 5) == 0
    assert chosen(choices.most_uncertain, [False, True, True, True, True]) == 3


def test_chance_takes_every_new_target_alike() -> None:
    new = [True, False, True, True, True]
    counts = np.bincount([chosen(choices.anywhere, new, seed) for seed in range(800)], minlength=5)
    assert counts[1] == 0
    # A share of a quarter of 800 has a deviation of 12; four of them.
    np.testing.assert_allclose(counts[[0, 2, 3, 4]], 200, atol=49)


@pytest.mark.parametrize("name", POLICIES)
def test_where_nothing_is_new_there_is_no_target(name: str) -> None:
    assert chosen(POLICIES[name].choose, [False] * 5) is None


def six_touches() -> tuple[Contacts, list[ProbeOutcome]]:
    normals = np.vstack([np.eye(3), -np.eye(3)])
    outcomes = [
        ProbeOutcome(Probe(RADIUS * n, -n, 0.1, 0.0), "touched", Contacts([RADIUS * n], [n]))
        for n in normals
    ]
    return Contacts(RADIUS * normals, normals), outcomes


@pytest.mark.parametrize(("step", "radius"), [(0.02, RADIUS), (0.05, 0.055)])
def test_a_guess_is_covered_before_the_estimate_in_use_is_tested(
    step: float, radius: float
) -> None:
    # Six touches of a ball of 50 mm leave gaps of 46 mm. With steps of 20 mm the guess, which is
    # that ball, comes first; with steps of 50 mm it is covered, and the estimate, a ball of 55 mm
    # and farther from the contacts, is put to the test.
    contacts, outcomes = six_touches()
    space = Workspace(step, np.zeros(3), 0.12)
    policy = TargetPolicy(space, choices.spread, guess=lambda _: Ball(RADIUS))
    rng = np.random.default_rng(0)
    probe = policy.next_probe(contacts, Ball(0.055), outcomes=outcomes, rng=rng)
    # Points of a surface are found to a part of a percent of a cell.
    assert np.linalg.norm(probe.target) == pytest.approx(radius, abs=2e-4)


def explored(name: str, policy: str) -> tuple[trimesh.Trimesh, Exploration]:
    shape = shapes.build(name, 0.2)
    space = Workspace(0.05, shape.mesh.bounds.mean(axis=0), shape.size)
    kind = POLICIES[policy]
    exploration = explore(
        KinematicProber(Hand.load("allegro"), shape.mesh),
        TargetPolicy(space, kind.choose, ESTIMATORS["gpis"] if kind.guesses else None),
        ESTIMATORS["gpis"],
        touches=16,
        space=space,
        rng=np.random.default_rng(1),
    )
    return shape.mesh, exploration


def test_spreading_covers_more_than_chance_with_as_many_touches() -> None:
    shares = {}
    for policy in ("spread", "random"):
        mesh, exploration = explored("box", policy)
        samples, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
        apart = np.linalg.norm(samples[:, None] - exploration.contacts.points, axis=-1)
        shares[policy] = np.mean(apart.min(axis=1) < 0.05)
    assert shares["spread"] > shares["random"] + 0.05
