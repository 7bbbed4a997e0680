"""The study beside other bodies: its scenes, its pairs of runs, and its table."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.world.touching import bodies_touching
from lis_grasp_studies.evaluation.part import Places
from lis_grasp_studies.evaluation.world_scenes import CLOSED, SCENES, make_scene
from lis_grasp_studies.evaluation.worlds import (
    WorldsPart,
    WorldTrial,
    at_rest,
    measure_world,
)
from lis_grasp_studies.evaluation.worlds_tables import (
    ALONE,
    DOES_NOT_FIT,
    losses_table,
    published,
    worlds_table,
)

BOX = shapes.find("box").mesh.copy()
BOX.apply_translation([0.0, 0.0, -BOX.bounds[0, 2]])


def test_there_are_24_scenes_that_the_box_fits_into() -> None:
    assert len(SCENES) == len(set(SCENES)) == 24
    for name in SCENES:
        for seed in (0, 1):
            world = make_scene(name, BOX, seed=seed)
            again = make_scene(name, BOX, seed=seed)
            assert bodies_touching(world, BOX) == []
            for body, same in zip(world, again, strict=True):
                np.testing.assert_array_equal(body.mesh.vertices, same.mesh.vertices)
                assert body.mesh.bounds[0, 2] > -1e-12


@pytest.mark.parametrize(("width", "height"), [(0.02, 0.1), (0.006, 0.006)])
def test_an_object_that_a_touch_topples_lies(width: float, height: float) -> None:
    # A bar of 100 mm tips at atan(width / 100 mm): 11.3 and 3.4 degrees.
    bar = shapes.Shape("bar", trimesh.creation.box((width, width, 0.1)), np.empty((0, 2, 3)))
    low, high = at_rest(bar).mesh.bounds
    assert high[2] - low[2] == pytest.approx(height)
    np.testing.assert_allclose([*(low + high)[:2], low[2]], 0.0, atol=1e-12)


@pytest.mark.parametrize("name", [name for name in SCENES if " mm" in name and name[0].isdigit()])
def test_neighbours_are_as_their_scene_says(name: str) -> None:
    """Their number, gap and kind; no two of them overlap."""
    count, kind, _, gap, _ = name.split()
    world = make_scene(name, BOX, seed=3)
    assert len(world) == int(count)
    assert all(body.is_fixed == (kind == "fixed") for body in world)
    for body in world:
        apart = np.maximum(body.mesh.bounds[0] - BOX.bounds[1], BOX.bounds[0] - body.mesh.bounds[1])
        assert apart.max() == pytest.approx(1e-3 * float(gap), abs=1e-9)
        if not body.is_fixed:
            assert body.inertial is not None
            assert 0.05 <= body.inertial.mass <= 1.0
    for one, other in combinations(world, 2):
        between = (
            one.mesh.bounds[0] - other.mesh.bounds[1],
            other.mesh.bounds[0] - one.mesh.bounds[1],
        )
        assert np.max(between) > 0.0


def test_a_twin_has_the_inertia_of_its_shape() -> None:
    (twin,) = make_scene("twin", BOX, seed=0)
    assert twin.inertial is not None
    a, b, c = np.ptp(BOX.bounds, axis=0)
    expected = 0.2 / 12.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    np.testing.assert_allclose(np.diag(twin.inertial.inertia_L), expected, rtol=1e-9)


def test_what_does_not_fit_is_in_no_rate() -> None:
    fits = {"object": "box", "scene": "slot", "reason": "held", "held": True}
    wide = {"object": "wide", "scene": "slot", "reason": DOES_NOT_FIT, "held": False}
    alone = [{**row, "scene": ALONE, "reason": "held", "held": True} for row in (fits, wide)]
    rows = [RUN | row for row in (*alone, fits, wide)]
    assert [line[:3] for line in worlds_table(rows).body] == [
        (ALONE, "2", "–"),
        ("slot, tight", "1", "100"),
        ("all tight", "1", "100"),
    ]


RUN = {"hand": "wsg50", "seed": 0, "policy": "spread"}


def test_each_object_meets_each_scene_by_one_hand_and_by_each_in_two_seeds() -> None:
    part = WorldsPart(
        measure="worlds", title="Worlds", variants=["spread"], seconds=60.0, seeds=[0, 1],
        objects=["box", "mallet"], hands=["allegro", "wsg50"],
    )  # fmt: skip
    first, second = part.rounds(Places())
    places = {(t.object, t.scene): t.hand for t in first if t.scene in SCENES}
    others = {(t.object, t.scene): t.hand for t in second if t.scene in SCENES}
    assert len(places) == 48
    assert all({hand, others[place]} == {"allegro", "wsg50"} for place, hand in places.items())
    for name in ("box", "mallet"):
        assert sum(places[name, scene] == "wsg50" for scene in SCENES) == 12
    for trials in (first, second):
        without = [(t.object, t.hand, t.scene) for t in trials if t.scene not in SCENES]
        assert len(without) == len({*without}) == 8
        assert {scene for *_, scene in without} == {ALONE, CLOSED}


def test_runs_beside_bodies_are_compared_with_the_same_runs_alone() -> None:
    measured = {
        "reason": "held", "held": True, "probes": 25, "blocked": 1, "felt": 22, "lost": 0,
        "lost_wrongly": 0, "refused": 0, "contacts_of_bodies": 0, "given_wrongly": 0,
        "touch_force": 0.0, "lift_force": 0.0, "moved_mm": 0.0, "pushed": "",
    }  # fmt: skip
    rows = []
    for name, cpu in (("box", 2.0), ("mallet", 4.0)):
        alone = RUN | measured | {"object": name, "scene": ALONE, "cpu": cpu, "cpu_touch": 1.0}
        rows += [alone, alone | {"scene": "bin", "cpu": 1.5 * cpu}]
    rows[1] |= {"lift_force": 2.5, "pushed": "east", "moved_mm": 11.0}
    rows[1] |= {"felt": 23, "contacts_of_bodies": 3, "given_wrongly": 1}
    rows[1] |= {"blocked": 4, "lost": 1, "lost_wrongly": 1, "held_in_mujoco": False}
    rows[3] |= {"held_in_mujoco": True}
    closed = RUN | {"object": "box", "scene": CLOSED, "held": False, "reason": "no_contact"}
    said = "20 probes blocked: no approach: lid is in the way"
    rows += [closed | {"probes": 0, "ended": said}, closed | {"probes": 100, "ended": said}]
    assert losses_table(rows).body == (("bin", "box", "wsg50", "held", "2.5", "east"),)
    line = dict(zip(worlds_table(rows).head, worlds_table(rows).body[1], strict=True))
    assert list(line.values()) == [
        "bin", "2", "50", "1", "1", "10", "0", "3", "1", "2.5", "11.0", "1.00", "1.50", "50",
    ]  # fmt: skip
    numbers = published(rows)
    assert (numbers["runs"], numbers["held wide"], numbers["held alone"]) == (2, 50.0, 100.0)
    assert (numbers["pushed"], numbers["moved"], numbers["lost wrongly"]) == (1, 1, 1)
    assert (numbers["felt"], numbers["given wrongly"]) == (45, 1)
    assert (numbers["said"], numbers["closed"]) == (1, 2)
    assert (numbers["judged alike"], numbers["judged"]) == (1, 2)
    assert numbers["blocked bin"] == pytest.approx(10.0)
    assert numbers["cpu bin"] == pytest.approx(1.5)


@pytest.mark.slow
def test_a_run_beside_bodies_is_measured() -> None:
    trial = WorldTrial("box", "wsg50", "bin", 0, "kinematic", 10)
    row = measure_world(trial, "spread")
    assert row["contacts"] == 10
    assert row["probes"] >= row["contacts"]
    assert row["given_wrongly"] == 0
    assert 0.0 < row["cpu_touch"] < row["cpu"]
    assert row["held"] == row["held_in_mujoco"]


@pytest.mark.slow
def test_a_closed_box_is_told_by_a_body_in_the_way() -> None:
    row = measure_world(WorldTrial("box", "wsg50", CLOSED, 0, "kinematic", 10), "spread")
    assert published([RUN | {"object": "box", "scene": CLOSED} | row])["said"] == 1
