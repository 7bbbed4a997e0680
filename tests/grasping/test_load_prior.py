"""Prior knowledge of mass and friction, and grip within the joint efforts."""

import numpy as np
import pytest
import trimesh

from lis_grasp import ForceClosureSampler, Hand
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.contact_wrenches import ContactModel, WrenchModel
from lis_grasp.grasping.grasp_quality import load_probability, shape_probability
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.grasping.hand_capacity import EFFORT_FRACTION, grip_fraction

JAW = Hand.load("wsg50")


def test_nodes_reproduce_the_moments_of_a_log_normal_distribution() -> None:
    spread = 0.3
    masses, weights = np.array(list(LoadPrior(mass=0.4, mass_spread=spread).masses())).T
    assert weights.sum() == pytest.approx(1.0)
    logs = np.log(masses / 0.4)
    # A Gauss-Hermite rule of three nodes is exact for polynomials up to degree 5.
    for power, moment in ((1, 0.0), (2, spread**2), (3, 0.0), (4, 3.0 * spread**4)):
        assert weights @ logs**power == pytest.approx(moment, abs=1e-12)


def test_a_known_value_is_one_node() -> None:
    prior = LoadPrior(0.5, 0.3)
    assert prior.is_known
    assert list(prior.frictions()) == [(0.5, 1.0)]
    assert list(prior.masses()) == [(0.3, 1.0)]


@pytest.mark.parametrize("name", ["friction", "mass", "friction_spread", "mass_spread"])
def test_values_out_of_range_are_refused(name: str) -> None:
    with pytest.raises(InvalidOptionError):
        LoadPrior(**{name: -1.0})


def test_a_grip_uses_at_most_the_efforts_of_the_joints() -> None:
    hand = Hand.load("allegro")
    q = np.array(hand.lower) + 0.4 * (hand.upper - hand.lower)
    _, _, jacobian, _ = hand.pad_jacobians(np.eye(4), q)
    force = np.array([[0.0, 0.0, 1000.0]])
    fraction = grip_fraction(hand, np.eye(4), q, hand.fingers[:1], force)
    assert 0.0 < fraction < 1.0
    used = np.abs(jacobian[0, :, 6:].T @ (fraction * force[0])) / hand.effort_limits
    assert used.max() == pytest.approx(EFFORT_FRACTION)
    assert grip_fraction(hand, np.eye(4), q, hand.fingers[:1], 1e-6 * force) == 1.0


def _best(**load: float) -> float:
    box = trimesh.creation.box((0.06, 0.05, 0.08))
    search = ForceClosureSampler(JAW, candidates=30, **load).sample(
        box, rng=np.random.default_rng(0), support_height=-0.04, count=1
    )
    return search.grasps[0].quality["success_probability"]


@pytest.mark.slow
def test_heavy_objects_are_predicted_to_be_held_less_often() -> None:
    found = [_best(mass=mass) for mass in (0.2, 10.0)]
    assert found[-1] < 0.1 * found[0]


@pytest.mark.slow
def test_success_over_an_unknown_load_is_between_those_at_its_extremes() -> None:
    spread = 0.4
    unknown = _best(mass=1.0, mass_spread=spread)
    light, heavy = (_best(mass=np.exp(s * np.sqrt(3.0) * spread)) for s in (-1.0, 1.0))
    assert heavy < unknown < light


def test_unseen_ends_displace_the_centre_of_mass_by_their_standard_deviation() -> None:
    ends = ((0.03, 0.0, 0.0), (0.0, 0.01, 0.0))
    centers, weights = map(np.array, zip(*LoadPrior(toward=ends).centers(), strict=True))
    assert weights.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(centers[0], 0.0)
    assert (centers >= 0.0).all()  # towards the end, never away
    # Each end has half of the weight, and there the second moment of a normal variable.
    np.testing.assert_allclose(weights @ centers**2, 0.5 * np.array(ends).sum(axis=0) ** 2)
    assert next(iter(LoadPrior().centers()))[1] == 1.0


@pytest.mark.slow
def test_a_bar_with_an_unseen_end_is_predicted_to_be_lost_more_often() -> None:
    bar, hand = trimesh.creation.box((0.03, 0.08, 0.03)), Hand.load("allegro")
    seen, unseen = (
        ForceClosureSampler(hand, LoadPrior(0.8, 0.2, toward=toward), candidates=300)
        .sample(bar, rng=0, support_height=-0.015, count=1)
        .grasps[0]
        .quality
        for toward in ((), ((0.0, 0.05, 0.0),))
    )
    assert unseen["success_probability"] < seen["success_probability"] - 0.1


@pytest.mark.parametrize("kind", ["coulomb", "soft_finger"])
def test_predicted_success_grows_with_load_and_strength_and_is_never_certain(
    kind: ContactModel,
) -> None:
    model = WrenchModel(0.8, kind)
    shape = shape_probability(np.linspace(0.0, 1.0, 50), model)  # no grip carries more than itself
    masses = np.array([[0.01], [0.2], [5.0]])
    carried = load_probability(np.geomspace(1e-3, 1e3, 50), masses, model)
    assert (np.diff(shape) > 0.0).all()
    assert (np.diff(carried, axis=1) > 0.0).all()
    assert (np.diff(carried, axis=0) < 0.0).all()
    assert shape.min() * carried.min() > 0.0
    assert shape.max() * carried.max() < 0.99
