"""Laws of estimators and of files, for any contacts and any numbers."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from random_directions import random_directions
from readers import sphere_contacts
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from lis_grasp import Contacts
from lis_grasp.exploration import Observation, Probe, ProbeOutcome, TouchLog
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.meshing import extract_mesh
from lis_grasp.motion import Motion
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import ESTIMATORS

every_estimator = pytest.mark.parametrize("name", list(ESTIMATORS))

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=4, deadline=None, derandomize=True)


def lumpy(rng: np.random.Generator) -> tuple[Contacts, np.ndarray]:
    """Return contacts of a rotated ellipsoid with a flat foot, and query points about it."""
    count = int(rng.integers(5, 40))
    u = random_directions(count, rng)
    axes = rng.uniform(0.03, 0.08, 3)
    points, normals = axes * u, u / axes
    foot = points[:, 2] < -0.4 * axes[2]
    points[foot, 2] = -0.4 * axes[2]
    normals[foot] = [0.0, 0.0, -1.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turn = Rotation.random(rng=rng).as_matrix()
    queries = rng.uniform(-0.1, 0.1, (30, 3))
    return Contacts(points @ turn.T, normals @ turn.T), queries


@pytest.mark.by_default("blend", "patch")
@every_estimator
@few
@given(seed=seeds)
def test_the_surface_moves_with_any_rigid_motion_and_scale(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, queries = lumpy(rng)
    R, p, s = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3), rng.uniform(0.1, 10)
    still = ESTIMATORS[name](contacts)
    moved = ESTIMATORS[name](Contacts(s * contacts.points @ R.T + p, contacts.normals @ R.T))
    there = s * queries @ R.T + p
    # Rounding of coordinates, as amplified by the equations of the Gaussian process.
    loose = {"rtol": 1e-5, "atol": 1e-6 * s}
    np.testing.assert_allclose(moved.evaluate(there), s * still.evaluate(queries), **loose)
    if name in ("lis", "gpis"):  # that of patches jumps where two of them meet
        # It is capped by the diagonal of the bounds, which are parallel to the axes.
        caps = [s * np.linalg.norm(np.ptp(still.bounds, axis=0))]
        caps.append(np.linalg.norm(np.ptp(moved.bounds, axis=0)))
        for uncertainty, expected in zip(
            moved.uncertainty(there), s * still.uncertainty(queries), strict=True
        ):
            if max(uncertainty, expected) < min(caps):
                np.testing.assert_allclose(uncertainty, expected, **loose)


@pytest.mark.slow
@every_estimator
@settings(max_examples=3, deadline=None, derandomize=True)
@given(seed=seeds)
def test_the_mesh_moves_with_any_rigid_motion_and_scale(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, _ = lumpy(rng)
    R, p, s = Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.5, 0.5, 3), rng.uniform(0.1, 10)
    moved_contacts = Contacts(s * contacts.points @ R.T + p, contacts.normals @ R.T)
    cube, cell = np.array([[-0.12] * 3, [0.12] * 3]), 0.004
    still = extract_mesh(ESTIMATORS[name](contacts), bounds=cube, resolution=cell)
    moved = extract_mesh(ESTIMATORS[name](moved_contacts), bounds=s * cube + p, resolution=s * cell)
    # The grid and the bounds do not rotate; the bounds close the surface far from all contacts.
    near = cKDTree(contacts.points).query(still.vertices)[0] < 0.02
    apart, _ = distances_to_mesh(s * still.vertices[near] @ R.T + p, moved)
    apart /= s * cell
    assert np.quantile(apart, 0.95) < 0.1
    assert apart.max() < 0.7  # at edges


@pytest.mark.by_default("lis", "gpis", "patch")
@every_estimator
@few
@given(seed=seeds)
def test_any_order_of_contacts_gives_the_same_surface(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, queries = lumpy(rng)
    shuffled = contacts.subset(rng.permutation(len(contacts)))
    first, second = ESTIMATORS[name](contacts), ESTIMATORS[name](shuffled)
    np.testing.assert_allclose(
        first.evaluate(queries), second.evaluate(queries), rtol=1e-6, atol=1e-9
    )


@every_estimator
@few
@given(seed=seeds)
def test_any_gradient_is_the_slope_of_the_values(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contacts, queries = lumpy(rng)
    surface = ESTIMATORS[name](contacts)
    way, step = rng.standard_normal(3), 1e-7
    way /= np.linalg.norm(way)
    ahead, here, behind = (surface.evaluate(queries + k * step * way) for k in (1, 0, -1))
    one, other = (ahead - here) / step, (here - behind) / step
    slopes = surface.gradient(queries) @ way
    # Between both one-sided slopes, which differ at a kink, and by curvature times the step.
    slack = 1e-4 * (1.0 + np.abs(slopes)) + np.abs(one - other)
    assert (slopes <= np.maximum(one, other) + slack).all()
    assert (slopes >= np.minimum(one, other) - slack).all()


# File round trips, for any numbers.

# Of letters that a format escapes; any letter takes hypothesis seconds to list.
texts = st.text('a{\\"\n\u00e9\u2028\U0001f600', max_size=9)
lengths = st.floats(-1e6, 1e6, allow_nan=False, allow_subnormal=True)
rows_of_three = st.lists(st.tuples(lengths, lengths, lengths), min_size=3, max_size=8)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(rows=rows_of_three, uncertainty=st.floats(0.0, 1e6))
def test_any_saved_surface_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory, rows: list, uncertainty: float
) -> None:
    faces = [[0, 1, 2]]
    attributes = {"uncertainty": np.full(len(rows), uncertainty)}
    mesh = trimesh.Trimesh(rows, faces, process=False, vertex_attributes=attributes)
    path = tmp_path_factory.mktemp("any") / "surface.ply"
    save_surface(mesh, path)
    again = load_surface(path)
    np.testing.assert_array_equal(again.vertices, np.array(rows, dtype=float))
    np.testing.assert_array_equal(again.vertex_attributes["uncertainty"], uncertainty)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=seeds, standoff=st.floats(0, 1e3), moved=st.floats(0, 1e3), reason=texts)
def test_any_logged_probe_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    standoff: float,
    moved: float,
    reason: str,
) -> None:
    rng = np.random.default_rng(seed)
    probe = Probe(rng.standard_normal(3), rng.standard_normal(3), standoff, 0.1)
    contacts = sphere_contacts(int(rng.integers(1, 4)), rng)
    outcome = ProbeOutcome(probe, "touched", contacts, reason=reason, moved=moved)
    path = tmp_path_factory.mktemp("any") / "touches.jsonl"
    TouchLog(path, {"seed": seed}).append(Observation(outcome))
    (read,) = TouchLog(path, {"seed": seed}).read().observations
    again = read.outcome
    np.testing.assert_array_equal(again.contacts.points, contacts.points)
    np.testing.assert_array_equal(again.probe.direction, probe.direction)
    assert (again.probe.standoff, again.moved, again.reason) == (standoff, moved, reason)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=seeds, count=st.integers(0, 9))
def test_any_saved_motion_loads_unchanged(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = [Rotation.random(rng=rng).as_matrix() for _ in range(count)] or 0.0
    poses[:, :3, 3] = rng.standard_normal((count, 3))
    bodies = {"palm": poses[::-1], "object": poses}
    motion = Motion(np.cumsum(rng.uniform(0.1, 1.0, count)), bodies)
    path = tmp_path_factory.mktemp("any") / "motion.npz"
    motion.save(path, header="made by a test")
    loaded = Motion.load(path)
    np.testing.assert_array_equal(loaded.times, motion.times)
    assert list(loaded.poses) == list(bodies)
    for name, expected in bodies.items():
        np.testing.assert_array_equal(loaded.poses[name], expected)
