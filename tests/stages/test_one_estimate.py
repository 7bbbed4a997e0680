"""The estimate of contacts is one: every door gives the same surface, to the last bit."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

import lis_grasp as lg
from lis_grasp.cli.main import main
from lis_grasp.drake import SurfaceEstimator
from lis_grasp.exploration import TouchLog
from lis_grasp.io import provenance
from lis_grasp.service.touch_service import TouchService
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.stages.next_touch import ObjectPlace
from lis_grasp.typing import FloatArray

HEIGHT = -0.03


@pytest.fixture(scope="module")
def contacts() -> lg.Contacts:
    """Contacts on a box on a table, some of them near the table, with free space."""
    rng, half = np.random.default_rng(0), np.array([0.05, 0.03, 0.03])
    axes = np.repeat(np.vstack([np.eye(3), -np.eye(3)])[:5], 6, axis=0)  # (30, 3), none below
    points = rng.uniform(-0.9, 0.9, (30, 3)) * half
    points = np.where(axes != 0.0, axes * half, points)
    points[::6, 2] = np.where(axes[::6, 2] == 0.0, HEIGHT + 0.008, points[::6, 2])
    free = np.array([[0.09, 0.0, 0.0], [0.0, 0.055, 0.01]])
    return lg.Contacts(points, axes, free_points=free, free_radii=np.full(2, 0.02))


def values(surface: lg.ImplicitSurface, points: FloatArray) -> FloatArray:
    return np.concatenate([surface.evaluate(points), surface.uncertainty(points)])


@pytest.mark.parametrize(
    "estimator", ["gpis", *(pytest.param(n, marks=pytest.mark.slow) for n in ("blend", "lis"))]
)
def test_every_door_gives_the_same_estimate(
    estimator: str, contacts: lg.Contacts, tmp_path: Path
) -> None:
    points = np.random.default_rng(1).uniform(-0.06, 0.06, (500, 3))
    surface = lg.estimate(contacts, estimator, support_height=HEIGHT)
    wanted, mesh = values(surface, points), lg.extract_mesh(surface, touched=contacts.points)

    # In a run.
    task = lg.Task.of("box", known=True, hand="wsg50", estimator=estimator, free=True)
    made = SurfaceEstimate(contacts, Agent.of(task, HEIGHT).perception)
    np.testing.assert_array_equal(values(made.surface, points), wanted)
    assert_same(made.mesh, mesh)

    # In a Diagram.
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantValueSource(AbstractValue.Make(contacts)))
    system = builder.AddSystem(SurfaceEstimator(estimator=estimator, table=HEIGHT))
    builder.Connect(source.get_output_port(), system.get_input_port())
    diagram = builder.Build()
    context = system.GetMyContextFromRoot(diagram.CreateDefaultContext())
    estimate = system.get_output_port().Eval(context)
    np.testing.assert_array_equal(values(estimate.surface, points), wanted)
    assert_same(estimate.mesh, mesh)

    # By the command, from a file that says where the table is.
    facts = {"free": True, "support_height": HEIGHT}
    contacts.save(tmp_path / "contacts.ply", header=provenance.describe(**facts))
    assert main(["estimate", str(tmp_path / "contacts.ply"), "--estimator", estimator]) == 0
    run = lg.Run.load(tmp_path)
    assert run.surface is not None
    assert run.mesh is not None
    np.testing.assert_array_equal(values(run.surface, points), wanted)
    written = mesh.vertices.astype(np.float32)  # as in the file
    np.testing.assert_allclose(run.mesh.vertices, written, rtol=0.0, atol=1e-7)

    # By the service of a robot's program.
    log = TouchLog(tmp_path / "served" / "touches.jsonl", {"hand": "wsg50", "estimator": estimator})
    place = ObjectPlace(support=HEIGHT)
    service = TouchService(Agent.of(task, 0.0), place, log.path.parent, log, before=contacts)
    assert service.answer({"request": "estimate"})["contacts"] == len(contacts)
    np.testing.assert_array_equal(lg.Run.load(log.path.parent).mesh.vertices, run.mesh.vertices)


def assert_same(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> None:
    np.testing.assert_array_equal(mesh.vertices, other.vertices)
    np.testing.assert_array_equal(mesh.faces, other.faces)


def test_each_part_of_an_estimate_is_made_once(contacts: lg.Contacts) -> None:
    made: list[int] = []

    def estimator(given: lg.Contacts) -> lg.ImplicitSurface:
        made.append(len(given))
        return lg.GaussianProcessImplicitSurface.from_contacts(given)

    estimate = SurfaceEstimate(contacts, Perception(estimator=estimator, support_height=HEIGHT))
    assert not made
    assert estimate.mesh.is_watertight
    assert estimate.surface.bounds.shape == (2, 3)
    (count,) = made
    assert count > len(contacts)  # walls near the table continue down to it
