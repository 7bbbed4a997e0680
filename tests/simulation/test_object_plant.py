"""An object on the simulated table: it comes to rest, and stays there."""

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.simulation.drake.object_plant import (
    add_object_body,
    add_support,
    add_table,
    let_rest,
)


def heights_after_a_fall(
    mesh: trimesh.Trimesh, mass: float, time_step: float, *, tilt: float, with_table: bool = False
) -> np.ndarray:
    """Return the height [m] of the object's frame in the last half of a second, at each step."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=time_step,
        contact_model="hydroelastic",
        discrete_contact_approximation="lagged",
    )
    plant, scene_graph = AddMultibodyPlant(config, builder)
    added = add_object_body(plant, mesh, mass=mass)
    height = float(mesh.bounds[0, 2])
    support = add_support(plant, height, 0.8, under=mesh, mass=mass)
    table = add_table(plant, height + 0.01, 0.8, under=mesh) if with_table else None
    plant.Finalize()
    let_rest(scene_graph, added.geometry, support=support, table=table)
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    tilted = trimesh.transformations.euler_matrix(tilt, 0.3 * tilt, 0.0)
    tilted[2, 3] = 0.001
    plant.SetFreeBodyPose(context, added.body, RigidTransform(tilted))
    heights = []
    for step in range(1, round(1.0 / time_step) + 1):
        simulator.AdvanceTo(step * time_step)
        heights.append(plant.EvalBodyPoseInWorld(context, added.body).translation()[2])
    return np.array(heights[len(heights) // 2 :])


@pytest.mark.by_default("size2-0.2-0.005")
@pytest.mark.parametrize("time_step", [pytest.param(0.002, marks=pytest.mark.slow), 0.005])
@pytest.mark.parametrize(
    ("size", "mass"),
    [([0.2, 0.03, 0.004], 0.065), ([0.1, 0.1, 0.02], 0.05), ([0.06, 0.06, 0.06], 0.2)],
)
def test_flat_objects_come_to_rest(size: list[float], mass: float, time_step: float) -> None:
    # On a table of the same stiffness for all, some of them never come to rest.
    mesh = trimesh.creation.box(size)
    for tilt in (0.01, 0.03, 0.06):
        heights = heights_after_a_fall(mesh, mass, time_step, tilt=tilt)
        assert np.ptp(heights) < 1e-6
        assert -1e-4 < heights[-1] < 0.0


@pytest.mark.slow
def test_a_ball_sinks_into_the_table_as_its_stiffness_says() -> None:
    # m g = pi E R d^2 / (half the thickness), E = 50 MPa, half the thickness 0.05 m.
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    heights = heights_after_a_fall(mesh, 0.5, 0.002, tilt=0.0)
    depth = np.sqrt(0.5 * 9.81 * 0.05 / (np.pi * 5e7 * 0.05))
    assert heights[-1] == pytest.approx(-depth, rel=0.1)


def test_an_object_rests_on_its_support_and_not_on_the_table_of_the_hand() -> None:
    heights = heights_after_a_fall(
        trimesh.creation.box([0.06, 0.06, 0.06]), 0.2, 0.005, tilt=0.0, with_table=True
    )
    assert heights[-1] == pytest.approx(0.0, abs=1e-4)  # that table is 10 mm higher
