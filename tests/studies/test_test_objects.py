"""Test objects: disjoint sets of sound shapes, with known volumes and edges."""

from __future__ import annotations

import numpy as np
import pytest

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.shapes import NAMES, sharp_edges
from lis_grasp.shapes.mesh_distance import winding_numbers
from lis_grasp_studies.test_objects import _organic
from lis_grasp_studies.test_objects.shape_sets import (
    BUILT_IN_SIZES,
    DEVELOPMENT,
    EVALUATION,
    HARD,
    LONG,
    TOOLS,
    build_shape,
    family_of,
)

ALL = [name for group in (DEVELOPMENT, EVALUATION) for names in group.values() for name in names]


def sorted_moments(name: str) -> np.ndarray:
    """Return the principal second moments of a solid, scaled to volume 1: the same at any size."""
    mesh = build_shape(name).mesh
    moments = np.sort(np.linalg.eigvalsh(mesh.moment_inertia))
    return moments / mesh.volume ** (5.0 / 3.0)


def test_development_and_evaluation_shapes_are_disjoint_and_many() -> None:
    assert len(set(ALL)) == len(ALL)
    assert set(NAMES) == set(BUILT_IN_SIZES) <= {n for ns in DEVELOPMENT.values() for n in ns}
    assert sum(map(len, EVALUATION.values())) >= 30
    assert set(EVALUATION) == set(DEVELOPMENT)


def test_no_evaluation_shape_is_a_rescaled_development_shape() -> None:
    known = np.array([sorted_moments(n) for names in DEVELOPMENT.values() for n in names])
    for name in (n for names in EVALUATION.values() for n in names):
        # Rescaled shapes would agree to rounding; tessellation moves moments by less than 0.1 %.
        nearest = np.abs(known / sorted_moments(name) - 1.0).max(axis=1).min()
        assert nearest > 0.005, name


def test_objects_that_are_hard_to_hold_are_new_to_all_other_sets() -> None:
    assert not {*HARD} & {*ALL, *NAMES, *LONG, *TOOLS}
    assert len(HARD) == 12
    for name in HARD:
        mesh = build_shape(name).mesh
        assert mesh.is_watertight, name
        assert mesh.body_count == 1, name
    washer = build_shape("washer").mesh
    assert washer.volume == pytest.approx(np.pi * (0.035**2 - 0.015**2) * 0.004, rel=0.002)


@pytest.mark.parametrize("name", ALL)
def test_a_test_object_is_one_closed_body_of_a_size_that_a_hand_explores(name: str) -> None:
    shape = build_shape(name)
    assert shape.name == name
    assert shape.mesh.body_count == 1
    assert 0.06 <= shape.size <= 0.26
    assert build_shape(name).mesh.volume > 1e-5
    smooth = family_of(name) == "organic" or name in ("sphere", "torus", "capsule", "bangle")
    assert (len(shape.edges) == 0) == (smooth or name == "rounded_box")


def test_organic_evaluation_shapes_are_new_and_of_other_generators_than_the_development_ones() -> (
    None
):
    assert len(EVALUATION["organic"]) >= 16
    makers = {build.func.__name__ for build in _organic.EVALUATION.values()}
    assert makers == {"_swept", "_grown"}
    for name in DEVELOPMENT["organic"]:
        assert not makers & {*getattr(_organic, name).__code__.co_names}


@pytest.mark.parametrize("name", EVALUATION["organic"])
def test_an_organic_evaluation_shape_is_smooth_closed_and_nowhere_inside_itself(name: str) -> None:
    mesh = build_shape(name).mesh
    assert mesh.is_watertight
    assert 0.04 <= mesh.extents.max() <= 0.2
    assert not len(sharp_edges(mesh))
    points = np.random.default_rng(0).uniform(*mesh.bounds, (2000, 3))
    windings = winding_numbers(points, mesh.vertices, mesh.faces)
    inside = windings > 0.5
    np.testing.assert_allclose(windings, inside, atol=1e-6)
    fraction = mesh.volume / np.prod(mesh.extents)
    deviation = np.sqrt(fraction * (1.0 - fraction) / len(points))  # of a binomial rate
    assert abs(np.mean(inside) - fraction) < 4.0 * deviation


@pytest.mark.parametrize(
    ("name", "volume", "edges"),
    [  # closed forms [m^3], [m]
        ("plate", 0.15 * 0.1 * 0.008, 4 * (0.15 + 0.1 + 0.008)),
        ("roof", 0.5 * 0.16 * 0.08 * 0.09, None),
        ("dodecahedron", None, 30 * 2.0 / ((1 + 5**0.5) / 2) * 0.05 / 3**0.5),
        ("cone", np.pi * 0.13 / 3 * (0.055**2 + 0.055 * 0.008 + 0.008**2), 2 * np.pi * 0.063),
        (
            "lens",
            2 * np.pi * 0.035**2 * (0.09 - 0.035 / 3),
            2 * np.pi * (0.09**2 - 0.055**2) ** 0.5,
        ),
        ("capsule", np.pi * 0.028**2 * (0.134 + 4 / 3 * 0.028), 0.0),
        ("bangle", 2 * np.pi * 0.036 * np.pi * 0.0035 * 0.007, 0.0),
    ],
)
def test_volumes_and_edges_are_those_of_the_closed_form(
    name: str, volume: float | None, edges: float | None
) -> None:
    # Inscribed polygons of n sides lack 2/3 (pi/n)^2 of the area: 0.3 % at 48, twice for a torus.
    shape = build_shape(name)
    if volume is not None:
        assert shape.mesh.volume == pytest.approx(volume, rel=0.01)
    if edges is not None:
        length = np.linalg.norm(shape.edges[:, 1] - shape.edges[:, 0], axis=1).sum()
        assert length == pytest.approx(edges, rel=0.005, abs=1e-12)


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        build_shape("no_such_shape")
    assert (error.value.option, error.value.value) == ("shape", "no_such_shape")
