"""The study beside other bodies: its scenes, its pairs of runs, and its table."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.world.touching import bodies_touching
from lis_grasp_studies.evaluation.part import Places
from lis_grasp_studies.evaluation.world_scenes import SCENES, make_scene
from lis_grasp_studies.evaluation.worlds import (
    ALONE,
    BESIDE,
    DOES_NOT_FIT,
    WorldsPart,
    WorldTrial,
    measure_world,
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
    fits = {"object": "box", "hand": "wsg50", "scene": "slot", "seed": 0, "reason": "held"}
    wide = fits | {"object": "wide", "reason": DOES_NOT_FIT}
    rows = [
        row | {"where": where, "held": row is fits, "cpu": 1.0, "cpu_touch": 1.0}
        for row in (fits, wide)
        for where in (ALONE, BESIDE)
    ]
    (line,) = worlds_table(rows).body
    assert line[:4] == ("slot, tight", "1", "100", "100")


def test_a_part_pairs_every_scene_with_the_run_alone() -> None:
    part = WorldsPart(
        measure="worlds", title="Worlds", variants=[ALONE, BESIDE], seconds=60.0, seeds=[0, 1],
        objects=["box", "mallet"], hands=["wsg50"],
    )  # fmt: skip
    rounds = part.rounds(Places())
    assert [len(trials) for trials in rounds] == [48, 48]
    facts = {"object": "box", "hand": "wsg50", "scene": "bin", "seed": 0, "reason": ""}
    alone = facts | {"where": ALONE, "held": True, "cpu": 2.0, "cpu_touch": 1.0}
    beside = alone | {
        "where": BESIDE, "cpu": 3.0, "cpu_touch": 1.5, "probes": 10, "blocked": 2,
        "contacts_of_bodies": 1, "touch_force": 0.1, "lift_force": 2.5, "moved_mm": 0.4,
    }  # fmt: skip
    (line,) = worlds_table([alone, beside]).body
    assert line == ("bin", "1", "100", "0", "20", "1", "2.5", "0.4", "1.50", "1.50")
    assert part.numbers([alone, beside]) == {ALONE: 1.0, BESIDE: 0.0}


@pytest.mark.slow
def test_a_run_beside_bodies_is_measured() -> None:
    trial = WorldTrial("box", "wsg50", "bin", 0, "kinematic", 10)
    row = measure_world(trial, BESIDE)
    assert row["contacts"] == 10
    assert row["probes"] >= row["contacts"]
    assert 0.0 < row["cpu_touch"] < row["cpu"]
