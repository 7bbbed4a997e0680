"""The Gymnasium environment: its interface, its geometry, its rewards, its agents."""

from __future__ import annotations

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from lis_grasp.exceptions import InvalidOptionError  # noqa: E402
from lis_grasp.exploration import Probe  # noqa: E402
from lis_grasp.shapes.mesh_distance import distances_to_mesh, winding_numbers  # noqa: E402
from lis_grasp_studies.environment import ID  # noqa: E402
from lis_grasp_studies.environment.agents import PolicyAgent, RandomAgent, play  # noqa: E402
from lis_grasp_studies.environment.touch_env import SALT, TouchEnv  # noqa: E402
from lis_grasp_studies.test_objects.salted import MIXED_FAMILIES, salted_shape  # noqa: E402


@pytest.mark.parametrize("answer", ["occupancy", "grasp"])
def test_gymnasium_accepts_the_environment(answer: str) -> None:
    check_env(gymnasium.make(ID, answer=answer, touches=3).unwrapped, skip_render_check=True)


def touched(env: TouchEnv) -> None:
    """Touch an object from random directions."""
    rng = np.random.default_rng(0)
    ended = False
    while not ended:
        along = rng.normal(size=3)
        action = env.action_of(Probe(np.zeros(3), along, 0.0, 0.0), np.zeros(8))
        _, _, ended, _, _ = env.step(action)


@pytest.mark.parametrize("number", range(len(MIXED_FAMILIES)))
def test_contacts_are_on_the_object_with_its_normals(number: int) -> None:
    env = TouchEnv(touches=12, queries=8)
    env.reset(seed=1, options={"number": number})
    touched(env)
    contacts, mesh = env.contacts, salted_shape(SALT, number, MIXED_FAMILIES).mesh
    assert 4 <= len(contacts) <= 12
    assert distances_to_mesh(contacts.points, mesh)[0].max() < 1e-12
    # On an edge the normal is that of either face: of one whose plane has the contact.
    offsets = contacts.points[:, None] - mesh.triangles[:, 0]  # (N, T, 3)
    on_plane = np.abs(np.einsum("nti,ti->nt", offsets, mesh.face_normals)) < 1e-9
    alike = np.einsum("ni,ti->nt", contacts.normals, mesh.face_normals) > 1.0 - 1e-9
    assert (on_plane & alike).any(axis=1).all()


def test_the_right_answer_loses_nothing_and_its_opposite_everything() -> None:
    env = TouchEnv(touches=2, queries=50)
    seen, info = env.reset(seed=3, options={"number": 0})
    mesh = salted_shape(SALT, 0, MIXED_FAMILIES).mesh
    assert info == {"object": "prism-0"}
    places = 0.5 * mesh.extents.max() * seen["queries"]
    solid = (winding_numbers(places, mesh.vertices, mesh.faces) > 0.5).astype(float)
    assert 0 < solid.sum() < 50
    probe = Probe(np.zeros(3), [0, 0, -1], 0.0, 0.0)
    assert env.step(env.action_of(probe, solid))[1] == 0.0
    assert env.step(env.action_of(probe, 1.0 - solid))[1] == -1.0


def test_opposite_points_hold_a_block_and_neighbours_do_not() -> None:
    env = TouchEnv(answer="grasp", touches=1)
    # Of a notched block the sides along y are flat and opposite, Nguyen (1988): they hold.
    number = tuple(MIXED_FAMILIES).index("notched")
    mesh = salted_shape(SALT, number, MIXED_FAMILIES).mesh
    half, width = 0.5 * mesh.extents.max(), 0.5 * mesh.extents[1]
    low = 0.25 * mesh.bounds[0, 2]
    touch = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    for second, expected in ((width, 1.0), (-width, 0.0), (0.3 * width, 0.0)):
        env.reset(seed=0, options={"number": number})
        points = np.array([[0.0, -width, low], [0.001, second, low]]) / half
        _, reward, ended, _, _ = env.step({"touch": touch, "answer": points})
        assert ended
        assert reward == expected


def test_the_same_seed_gives_the_same_episode_and_copies_run_side_by_side() -> None:
    several = gymnasium.make_vec(ID, num_envs=3, touches=4, queries=5)
    seen = []
    for _ in range(2):
        several.reset(seed=5)
        several.action_space.seed(5)
        seen.append([several.step(several.action_space.sample())[0] for _ in range(4)][-1])
    for name, first in seen[0].items():
        np.testing.assert_array_equal(first, seen[1][name])
    assert seen[0]["contacts"].shape == (3, 4, 6)
    assert not np.array_equal(seen[0]["contacts"][0], seen[0]["contacts"][1])


@pytest.mark.slow
def test_chosen_touches_beat_random_ones() -> None:
    env, numbers = TouchEnv(), range(18)
    means = {
        type(agent).__name__: np.mean([play(env, agent, seed=0, number=k) for k in numbers])
        for agent in (RandomAgent(), PolicyAgent("uncertainty"))
    }
    assert means["PolicyAgent"] > means["RandomAgent"]


@pytest.mark.parametrize("options", [{"answer": "shape"}, {"touches": 0}, {"objects": 0}])
def test_wrong_options_are_refused(options: dict) -> None:
    with pytest.raises(InvalidOptionError):
        TouchEnv(**options)
