"""Exploration policies: the target that each selects, and the surface that it searches."""

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
    explore,
)
from lis_grasp.exploration.policy import (
    TargetSelector,
    farthest,
    fastest,
    most_uncertain,
    uniform,
)
from lis_grasp.exploration.target_candidates import Targets
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


def targets(eligible: list[bool]) -> Targets:
    points = np.array([[0.0, 0.0, z] for z in (0.05, 0.01, 0.02, 0.04, 0.03)])
    return Targets(
        points, points / 0.05, NEAREST, NEAREST, NEAREST, np.array(eligible), 0.02, SECONDS
    )


def selected(select: TargetSelector, eligible: list[bool], seed: int = 0) -> int | None:
    return select(targets(eligible), Ball(), rng=np.random.default_rng(seed))


def test_farthest_selects_the_eligible_target_with_the_largest_gap() -> None:
    assert selected(farthest, [True] * 5) == 2
    assert selected(farthest, [True, True, False, True, True]) == 4


def test_fastest_selects_the_largest_squared_gap_per_second() -> None:
    assert selected(fastest, [True] * 5) == 4  # 11 cm^2 / s, of 1, 9, 8 and 4
    assert selected(fastest, [True, True, True, True, False]) == 1


def test_most_uncertain_selects_the_largest_deviation() -> None:
    assert selected(most_uncertain, [True] * 5) == 0
    assert selected(most_uncertain, [False, True, True, True, True]) == 3


def test_uniform_selects_every_eligible_target_equally_often() -> None:
    eligible = [True, False, True, True, True]
    counts = np.bincount([selected(uniform, eligible, seed) for seed in range(800)], minlength=5)
    assert counts[1] == 0
    # A quarter of 800 has a standard deviation of 12; four of them.
    np.testing.assert_allclose(counts[[0, 2, 3, 4]], 200, atol=49)


@pytest.mark.parametrize("name", POLICIES)
def test_without_eligible_targets_none_is_selected(name: str) -> None:
    assert selected(POLICIES[name].select, [False] * 5) is None


def six_touches() -> tuple[Contacts, list[ProbeOutcome]]:
    normals = np.vstack([np.eye(3), -np.eye(3)])
    outcomes = [
        ProbeOutcome(Probe(RADIUS * n, -n, 0.1, 0.0), "touched", Contacts([RADIUS * n], [n]))
        for n in normals
    ]
    return Contacts(RADIUS * normals, normals), outcomes


@pytest.mark.parametrize(("step", "radius"), [(0.02, RADIUS), (0.05, 0.055)])
def test_the_guess_is_searched_before_the_estimate(step: float, radius: float) -> None:
    # Six touches of a ball of 50 mm leave gaps of 46 mm. With steps of 20 mm the guess, which is
    # that ball, comes first. With steps of 50 mm it is covered, and the estimate, a ball of 55 mm
    # and farther from the contacts, is searched.
    contacts, outcomes = six_touches()
    space = Workspace(step, np.zeros(3), 0.12)
    policy = TargetPolicy(space, farthest, guess=lambda _: Ball(RADIUS))
    rng = np.random.default_rng(0)
    probe = policy.next_probe(contacts, Ball(0.055), outcomes=outcomes, rng=rng)
    # Samples are on the surface within a percent of a cell of 5 mm and more.
    assert np.linalg.norm(probe.target) == pytest.approx(radius, abs=2e-4)


def explored(name: str, policy: str) -> tuple[trimesh.Trimesh, Exploration]:
    shape = shapes.build(name, 0.2)
    space = Workspace(0.05, shape.mesh.bounds.mean(axis=0), shape.size)
    kind = POLICIES[policy]
    exploration = explore(
        KinematicProber(Hand.load("allegro"), shape.mesh),
        TargetPolicy(
            space, kind.select, ESTIMATORS["gpis"] if kind.uses_gaussian_process else None
        ),
        ESTIMATORS["gpis"],
        touches=16,
        space=space,
        rng=np.random.default_rng(1),
    )
    return shape.mesh, exploration


def test_spread_covers_more_than_random_with_as_many_touches() -> None:
    covered = {}
    for policy in ("spread", "random"):
        mesh, exploration = explored("box", policy)
        samples, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
        apart = np.linalg.norm(samples[:, None] - exploration.contacts.points, axis=-1)
        covered[policy] = np.mean(apart.min(axis=1) < 0.05)
    assert covered["spread"] > covered["random"] + 0.05
