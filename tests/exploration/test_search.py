"""Search for an object in a region, and the workspace that its contacts show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Probe, ProbeOutcome, Region, RegionPolicy, TargetPolicy
from lis_grasp.exploration.region import PlaceBelief, search_probe
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.probing.keep_out import KeepOut
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp.typing import FloatArray

REGION = Region()
TIP = 0.012


def free(points: FloatArray) -> PlaceBelief:
    return PlaceBelief.of(REGION, points, np.full(len(points), TIP))


class Ball:
    """Prober of a ball on the table by rays of a fingertip, without a hand."""

    def __init__(self, center: FloatArray, radius: float) -> None:
        self.center, self.radius = np.append(center, radius), radius

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        along = np.arange(0.0, probe.standoff + probe.overshoot, 0.005)
        tips = probe.start + along[:, None] * probe.direction
        gaps = np.linalg.norm(tips - self.center, axis=1) - self.radius - TIP
        touched = np.flatnonzero(gaps < 0.0)
        tips = tips[: touched[0]] if len(touched) else tips
        radii = np.full(len(tips), TIP)
        if not len(touched):
            return ProbeOutcome(probe, "missed", free_points=tips, free_radii=radii)
        normal = probe.start + along[touched[0]] * probe.direction - self.center
        normal /= np.linalg.norm(normal)
        contacts = Contacts((self.center + self.radius * normal)[None], normal[None])
        return ProbeOutcome(probe, "touched", contacts, free_points=tips, free_radii=radii)


def test_nothing_is_ruled_out_before_the_first_motion() -> None:
    assert free(np.empty((0, 3))).weights.sum() == pytest.approx(1.0)


def test_a_ball_of_free_space_rules_out_the_places_that_overlap_it() -> None:
    belief = free(np.array([[0.05, 0.05, 0.02]]))
    distances = np.linalg.norm(belief.centers - [0.05, 0.05], axis=1)
    touching = (distances < belief.radii) & (belief.heights > 0.02)
    assert 0.8 < belief.weights.sum() < 1.0
    assert not touching.any()


def test_free_space_above_an_object_does_not_rule_it_out() -> None:
    assert free(np.array([[0.05, 0.05, 0.2]])).weights.sum() == pytest.approx(1.0)


def test_space_that_is_all_free_leaves_no_place_and_no_probe() -> None:
    axis = np.arange(-0.2, 0.2001, 0.01)
    grid = np.stack(np.meshgrid(axis, axis, [0.005], indexing="ij"), axis=-1).reshape(-1, 3)
    assert free(grid).weights.sum() == 0.0
    swept = ProbeOutcome(
        Probe(np.zeros(3), np.eye(3)[0], 0.1, 0.1),
        "missed",
        free_points=grid,
        free_radii=np.full(len(grid), TIP),
    )
    assert search_probe(REGION, [swept], rng=np.random.default_rng(0)) is None


def test_where_only_a_thin_object_fits_between_sweeps_it_is_sought() -> None:
    along, across = np.arange(-0.2, 0.2001, 0.01), np.arange(-0.204, 0.205, 0.034)
    grid = np.stack(np.meshgrid(along, across, [0.005], indexing="ij"), axis=-1).reshape(-1, 3)
    belief = free(grid)
    assert 0.0 < belief.radii.max() < 0.034 / 2.0 - np.sqrt(0.01**2 - 0.001**2)


def test_the_first_motion_is_a_low_sweep_through_the_region() -> None:
    probe = search_probe(REGION, [], rng=np.random.default_rng(0))
    assert abs(probe.direction[2]) < 1e-12
    assert 0.0 < probe.start[2] < 0.06
    assert probe.standoff + probe.overshoot >= 0.4


def test_a_sweep_begins_outside_by_the_space_that_is_free_around_the_region() -> None:
    probe = search_probe(Region(around=0.12), [], rng=np.random.default_rng(0))
    level = np.abs(probe.direction[:2]) > 0.5
    assert np.abs(probe.start[:2])[level] == pytest.approx(0.2 + TIP + 0.12)
    assert np.abs(probe.end[:2])[level] == pytest.approx(0.2 + TIP)


def test_before_contacts_show_an_object_only_the_region_may_hold_it() -> None:
    space = REGION.grown(Contacts.empty())
    inside = np.array([[0.19, 0.0, 0.1], [0.0, 0.0, 0.29]])
    outside = np.array([[0.21, 0.0, 0.1], [0.0, 0.0, 0.31]])
    obstacles = ObstacleModel(space, Contacts.empty(), None, REGION.bounds)
    assert KeepOut(obstacles).may_touch(inside).all()
    assert not KeepOut(obstacles).may_touch(outside).any()
    assert KeepOut(replace(obstacles, region=None)).may_touch(outside).all()  # a ball about it


def test_a_blocked_motion_is_not_repeated() -> None:
    outcomes: list[ProbeOutcome] = []
    for _ in range(5):
        probe = search_probe(REGION, outcomes, rng=np.random.default_rng(0))
        for earlier in outcomes:
            same = np.allclose(probe.target, earlier.probe.target)
            assert not (same and np.allclose(probe.direction, earlier.probe.direction))
        outcomes.append(ProbeOutcome(probe, "blocked", reason="no approach"))
    # A hand that cannot go low fails in level sweeps: others, and motions down, are tried.
    ways = {(*np.round(o.probe.direction, 6), round(o.probe.start[2], 6)) for o in outcomes}
    assert len(ways) == len(outcomes)


@pytest.mark.parametrize(
    "radius", [0.015, *(pytest.param(r, marks=pytest.mark.slow) for r in (0.03, 0.05))]
)
def test_a_ball_is_found_anywhere(radius: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(2):
        prober = Ball(rng.uniform(-0.2 + radius, 0.2 - radius, size=2), radius)
        outcomes: list[ProbeOutcome] = []
        while not outcomes or outcomes[-1].status == "missed":
            probe = search_probe(REGION, outcomes, rng=rng)
            outcomes.append(prober.probe(probe))
        # Sweeps of the width of ball and tip, twice, cover the region.
        assert len(outcomes) <= 2.0 * 0.4 / (2.0 * (radius + TIP)) + 2


def test_the_workspace_grows_with_the_contacts() -> None:
    point, normal = np.array([[0.1, 0.0, 0.03]]), np.array([[1.0, 0.0, 0.0]])
    one = REGION.grown(Contacts(point, normal))
    assert one.support_height == 0.0
    assert one.center[0] < 0.1  # the object is behind the contact
    points = np.array([[0.1, 0.0, 0.03], [-0.05, 0.0, 0.03], [0.02, 0.06, 0.08]])
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    three = REGION.grown(Contacts(points, normals))
    assert np.allclose(three.center, [0.025, 0.03, 0.04])
    assert three.size >= 0.15
    repeated = Contacts(np.tile(points, (20, 1)), np.tile(normals, (20, 1)))
    assert 0.15 <= REGION.grown(repeated).size < three.size


def test_after_the_first_contact_the_other_sides_are_touched() -> None:
    prober, policy = Ball(np.array([0.1, -0.05]), 0.04), RegionPolicy(REGION, TargetPolicy)
    rng, outcomes, contacts = np.random.default_rng(0), [], Contacts.empty()
    while sum(len(outcome.contacts) for outcome in outcomes) < 5:
        probe = policy.next_probe(contacts, None, outcomes=outcomes, rng=rng)
        outcomes.append(prober.probe(probe))
        contacts = contacts.append(outcomes[-1].contacts)
        assert len(outcomes) < 30
    space = REGION.grown(contacts)
    assert np.linalg.norm(space.center[:2] - [0.1, -0.05]) < 0.01
    assert space.size >= 0.08
    first = next(i for i, outcome in enumerate(outcomes) if len(outcome.contacts))
    purposes = [outcome.probe.purpose for outcome in outcomes]
    assert purposes[: first + 1] == ["search"] * (first + 1)
    assert purposes[first + 1] == "extent"


def test_a_cloud_makes_the_other_sides_known() -> None:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(80, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = Contacts(0.04 * normals + [0.1, -0.05, 0.04], normals)
    surface = GaussianProcessImplicitSurface.from_contacts(cloud)
    touched = Ball(np.array([0.1, -0.05]), 0.04).probe(
        Probe(np.array([0.14, -0.05, 0.04]), np.array([-1.0, 0.0, 0.0]), 0.1, 0.1)
    )
    known = cloud.append(touched.contacts)
    probes = [
        policy.next_probe(known, surface, outcomes=[touched], rng=np.random.default_rng(1))
        for policy in (RegionPolicy(REGION, TargetPolicy), TargetPolicy(REGION.grown(known)))
    ]
    np.testing.assert_array_equal(probes[0].target, probes[1].target)


@pytest.mark.parametrize("lengths", [(0.4, 0.4), (0.4, 0.4, 0.0), (0.4, np.nan, 0.3), "box", 0.4])
def test_a_region_without_three_positive_lengths_is_refused(lengths: object) -> None:
    with pytest.raises(InvalidOptionError) as error:
        Region(lengths)
    assert error.value.option == "region"


class Coin(Ball):
    """Prober of a thin upright cylinder on the table; a fingertip's ball meets its rim."""

    height = 0.004

    def probe(self, probe: Probe, obstacles: ObstacleModel | None = None) -> ProbeOutcome:
        along = np.arange(0.0, probe.standoff + probe.overshoot, 0.002)
        tips = probe.start + along[:, None] * probe.direction
        offsets = tips[:, :2] - self.center[:2]
        beside = np.maximum(np.linalg.norm(offsets, axis=1) - self.radius, 0.0)
        above = np.maximum(tips[:, 2] - self.height, 0.0)
        touched = np.flatnonzero(np.hypot(beside, above) < TIP)
        if not len(touched):
            radii = np.full(len(tips), TIP)
            return ProbeOutcome(probe, "missed", free_points=tips, free_radii=radii)
        rim = np.append(self.center[:2], self.height)[None]
        return ProbeOutcome(probe, "touched", Contacts(rim, np.array([[0.0, 0.0, 1.0]])))


@pytest.mark.parametrize("tip_radius", [0.006, TIP])
def test_a_thing_of_4_mm_is_found_by_sweeps_as_low_as_the_fingertip_goes(tip_radius: float) -> None:
    region, rng = Region(tip_radius=tip_radius), np.random.default_rng(0)
    coin = Coin(np.array([0.07, -0.05]), 0.03)
    outcomes: list[ProbeOutcome] = []
    while not outcomes or outcomes[-1].status == "missed":
        assert len(outcomes) < 15
        probe = search_probe(region, outcomes, rng=rng)
        level = probe.direction[2] == 0.0
        assert not level or min(probe.start[2], probe.end[2]) > tip_radius
        outcomes.append(coin.probe(probe))
    assert outcomes[-1].status == "touched"
