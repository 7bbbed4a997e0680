"""Grasps of symmetric grippers, whose fingers face each other instead of a thumb."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import trimesh
from ring_gripper import three_fingers

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.grasping._antipodal_sampling import sample_contact_sets
from lis_grasp.grasping._contact_samples import SurfaceSamples
from lis_grasp.robots.draft.pipeline import draft_hand


@cache
def ring_hand() -> Hand:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "hand.urdf"
        path.write_text(three_fingers())
        return draft_hand(path, name="hand", rng=np.random.default_rng(0)).hand


@pytest.mark.parametrize("radius", [0.02, 0.045])
def test_contacts_round_a_ball_are_a_third_of_a_turn_apart(radius: float) -> None:
    """Their normals then sum to 0, however wide the hand opens.

    So are half of the sets, of which half are on a line through the middle of the ball, and half
    of these, of a palm that does not lean: one in eight, or 25 of 200 with a standard deviation of
    5, from which 10 are 3 of them.
    """
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    rng = np.random.default_rng(0)
    samples = SurfaceSamples(ball, lowest=-np.inf, rng=rng, pad_radius=0.009)
    sets, _ = sample_contact_sets(ring_hand(), samples, count=200, rng=rng)
    off = np.linalg.norm(sets.normals.sum(axis=1), axis=1)
    assert np.count_nonzero(off < 0.2) > 10


@pytest.mark.parametrize("name", ["box", "cylinder", "hollow_cylinder"])
def test_a_symmetric_gripper_finds_a_grasp_of(name: str) -> None:
    mesh = shapes.build(name).mesh
    low = float(mesh.bounds[0, 2])
    sampler = ForceClosureSampler(ring_hand(), friction=0.8, candidates=400)
    search = sampler.sample(mesh, rng=np.random.default_rng(0), support_height=low, count=1)
    assert len(search) == 1
    assert search.best.success_probability > 0.5
