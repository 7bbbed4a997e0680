"""Laws that every estimator obeys."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError
from lis_grasp.geometry import unit
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface
from lis_grasp.surfaces.contact_preparation import merge_duplicates

every_estimator = pytest.mark.parametrize("name", list(ESTIMATORS))


def touched_cylinder() -> Contacts:
    """Contacts of a cylinder, radius 40 mm, height 100 mm: flat, curved and sharp; irregular."""
    rng = np.random.default_rng(0)
    turn, height = np.meshgrid(np.arange(8), [-0.035, 0.0, 0.035])
    angle = (turn + 0.5 * (height > 0)).ravel() * np.pi / 4 + rng.uniform(-0.1, 0.1, 24)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(24)])
    points = 0.04 * normals
    points[:, 2] = height.ravel() + rng.uniform(-0.004, 0.004, 24)
    for side in (-1.0, 1.0):
        radius, angle = np.array([0.0, *[0.028] * 5]), np.arange(6) * 1.25 + rng.uniform()
        flat = np.column_stack(
            [radius * np.cos(angle), radius * np.sin(angle), np.full(6, 0.05 * side)]
        )
        points = np.vstack([points, flat])
        normals = np.vstack([normals, np.tile([0.0, 0.0, side], (6, 1))])
    return Contacts(points, normals)


def queries(count: int = 200) -> np.ndarray:
    return np.random.default_rng(7).uniform(-0.08, 0.08, (count, 3))


@every_estimator
def test_an_estimator_makes_an_implicit_surface(name: str) -> None:
    surface = ESTIMATORS[name](touched_cylinder())
    assert isinstance(surface, ImplicitSurface)
    assert surface.bounds.shape == (2, 3)
    assert (surface.bounds[0] < touched_cylinder().points.min(axis=0)).all()
    assert (surface.bounds[1] > touched_cylinder().points.max(axis=0)).all()


@every_estimator
@pytest.mark.parametrize("shape", [(), (1,), (0,), (4, 3), (2, 0, 5)])
def test_results_have_the_shape_of_the_queries(name: str, shape: tuple[int, ...]) -> None:
    surface = ESTIMATORS[name](touched_cylinder())
    points = np.zeros((*shape, 3))
    assert surface.evaluate(points).shape == shape
    assert surface.gradient(points).shape == (*shape, 3)
    assert surface.uncertainty(points).shape == shape


@every_estimator
def test_inside_is_negative_and_outside_is_positive(name: str) -> None:
    contacts = touched_cylinder()
    surface = ESTIMATORS[name](contacts)
    points = queries(3000)
    radial = np.hypot(points[:, 0], points[:, 1]) - 0.04
    distance = np.maximum(radial, np.abs(points[:, 2]) - 0.05)
    # Planes 31 mm apart leave a cylinder of 40 mm by 31^2 / (8 * 40) = 3 mm, at the rim by more.
    clear = (np.abs(distance) > 0.01) & (distance < 0.5 * contacts.spacing)
    assert (np.sign(surface.evaluate(points))[clear] == np.sign(distance)[clear]).all()


@every_estimator
def test_the_zero_set_passes_through_the_contacts_facing_outward(name: str) -> None:
    contacts = touched_cylinder()
    surface = ESTIMATORS[name](contacts)
    step = 0.004
    assert (surface.evaluate(contacts.points + step * contacts.normals) > 0).all()
    assert (surface.evaluate(contacts.points - step * contacts.normals) < 0).all()
    gradients = surface.gradient(contacts.points)
    cosines = np.einsum("nk,nk->n", gradients, contacts.normals) / np.linalg.norm(gradients, axis=1)
    assert np.median(cosines) > 0.98
    assert (cosines > 0.8).all()


@every_estimator
@pytest.mark.parametrize(
    ("turn", "move", "factor"),
    [([0.3, -1.1, 0.7], [0.5, -0.2, 0.1], 1.0), ([0] * 3, [0] * 3, 0.01), ([0] * 3, [0] * 3, 30.0)],
)
def test_turning_moving_and_scaling_the_object_does_so_to_the_surface(
    name: str, turn: list[float], move: list[float], factor: float
) -> None:
    contacts, points = touched_cylinder(), queries()
    R = Rotation.from_rotvec(turn).as_matrix()
    moved = Contacts(factor * contacts.points @ R.T + move, contacts.normals @ R.T)
    here, there = ESTIMATORS[name](contacts), ESTIMATORS[name](moved)
    at, close = factor * points @ R.T + move, np.testing.assert_allclose
    atol = 1e-8 * factor
    close(there.evaluate(at), factor * here.evaluate(points), rtol=1e-6, atol=atol)
    close(there.gradient(at), here.gradient(points) @ R.T, rtol=1e-4, atol=1e-5)
    close(there.uncertainty(at), factor * here.uncertainty(points), rtol=1e-5, atol=atol)
    if not any(turn):
        close(there.bounds, factor * here.bounds)


@every_estimator
def test_the_same_contacts_give_the_same_bytes(name: str) -> None:
    points = queries()
    first = ESTIMATORS[name](touched_cylinder()).evaluate(points)
    second = ESTIMATORS[name](touched_cylinder()).evaluate(points)
    assert first.tobytes() == second.tobytes()


@every_estimator
@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_contacts_suffice(name: str, count: int) -> None:
    contacts = touched_cylinder().subset(slice(0, count))
    surface = ESTIMATORS[name](contacts)
    assert np.isfinite(surface.evaluate(queries())).all()
    assert np.isfinite(surface.gradient(queries())).all()
    assert (surface.uncertainty(queries()) >= 0).all()
    assert (surface.bounds[1] > surface.bounds[0]).all()


@every_estimator
def test_uncertainty_is_small_at_contacts_and_larger_between_them(name: str) -> None:
    contacts = touched_cylinder()
    surface = ESTIMATORS[name](contacts)
    untouched = ESTIMATORS[name](contacts.subset(contacts.points[:, 2] < 0.03))
    top = np.array([0.0, 0.0, 0.05])
    assert surface.uncertainty(contacts.points).max() < 0.1 * contacts.spacing
    assert untouched.uncertainty(top) > surface.uncertainty(contacts.points).max()


@pytest.mark.parametrize(
    "name", ["gpis", *(pytest.param(n, marks=pytest.mark.slow) for n in ("smooth", "blend"))]
)
def test_a_ball_touched_by_pads_is_not_cut_off(name: str) -> None:
    # Twelve touches of five contacts within 2 mm; none is higher than 85 % of the radius.
    ball = trimesh.creation.icosahedron().vertices
    beside = 0.02 * np.random.default_rng(0).normal(size=(5, 12, 3))
    normals = unit(ball / np.linalg.norm(ball[0]) + beside).reshape(-1, 3)
    mesh = extract_mesh(ESTIMATORS[name](Contacts(0.05 * normals, normals)))
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.05).max() < 0.001


@every_estimator
def test_no_contacts_are_refused(name: str) -> None:
    with pytest.raises(InvalidContactsError):
        ESTIMATORS[name](Contacts.empty())


@every_estimator
@pytest.mark.parametrize(
    "points", [np.zeros(2), np.zeros((3, 4)), np.array(1.0), [[0, np.nan, 0]], [1e160, 0, 0]]
)
def test_queries_of_another_shape_or_not_finite_are_refused(name: str, points: object) -> None:
    surface = ESTIMATORS[name](touched_cylinder())
    for ask in (surface.evaluate, surface.gradient, surface.uncertainty):
        with pytest.raises(InvalidOptionError) as error:
            ask(points)
        assert error.value.option == "points"


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [
        *((name, "position_noise", -1e-3) for name in ESTIMATORS),
        *((name, "normal_noise", value) for name in ESTIMATORS for value in (np.nan, np.inf)),
        *(("gpis", "kernel", "cubic"), ("gpis", "length", 0.0)),
        *(("gpis", "misfit", (0.0, -0.1)), ("gpis", "prior_mean", -0.1)),
        *(("lis", "sigma", 0.0), ("lis", "sigma", np.nan), ("lis", "beta", "minus")),
    ],
)
def test_an_option_out_of_range_is_refused(name: str, option: str, value: object) -> None:
    with pytest.raises(InvalidOptionError) as error:
        ESTIMATORS[name](touched_cylinder(), **{option: value})
    assert error.value.option == option


@pytest.mark.parametrize("name", ["lis", "patch", "blend"])
def test_repeated_noisy_contacts_are_one_place_each(name: str) -> None:
    places, noise = touched_cylinder(), 5e-4
    moves = noise * np.random.default_rng(3).normal(size=(2 * len(places), 3))
    twice = Contacts(np.tile(places.points, (2, 1)) + moves, np.tile(places.normals, (2, 1)))
    noise_options = {"position_noise": noise, "normal_noise": 0.05}
    once = ESTIMATORS[name](places, **noise_options)
    surface = ESTIMATORS[name](twice, **noise_options)
    spacings = [getattr(some, "sharp", some).spacing for some in (surface, once)]
    assert spacings[0] == pytest.approx(spacings[1], rel=0.05)
    unsure = [np.median(some.uncertainty(queries())) for some in (surface, once)]
    assert unsure[0] < 1.5 * unsure[1]


def test_noise_as_large_as_the_spacing_merges_nothing() -> None:
    contacts = touched_cylinder()
    merged = merge_duplicates(contacts, position_noise=contacts.spacing)
    np.testing.assert_array_equal(merged.points, contacts.points)


def test_merging_keeps_places_in_order_and_corners_apart() -> None:
    contacts = Contacts(
        [[0, 0, 0], [1, 0, 0], [1e-4, 0, 0], [1, 0, 0], [0, 2, 0]],
        [[0, 0, 1], [1, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 0]],
    )
    merged = merge_duplicates(contacts)
    np.testing.assert_allclose(merged.points, [[5e-5, 0, 0], [1, 0, 0], [1, 0, 0], [0, 2, 0]])
    np.testing.assert_allclose(merged.normals, [[0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 1, 0]])
