"""Clouds beside touches: joined files, and explorations that know a cloud."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp import pipeline, shapes
from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.exploration import TactileSensor, load_outcomes
from lis_grasp.io.surface_files import load_surface
from lis_grasp.pipeline import ContactSource, RunConfig, Scenario
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.contact_sources import join_sources, load_source
from lis_grasp.stages.estimate import Perception
from lis_grasp.stages.touch import touch
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp.task.task import Task

NOISE, TILT = 0.001, 0.05


def box_cloud(count: int, *, top: bool, noise: float = NOISE) -> Contacts:
    """Points with normals on the box that is explored by default, or on its upper half."""
    mesh = shapes.find("box", size=None).mesh
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    normals = np.asarray(mesh.face_normals)[faces]
    chosen = (points[:, 2] > mesh.bounds.mean(axis=0)[2]) | (not top)
    rng = np.random.default_rng(0)
    tilted = normals + TILT * rng.normal(size=normals.shape)
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    return Contacts(points + noise * rng.normal(size=points.shape), tilted).subset(chosen)


@pytest.fixture
def upper_half(tmp_path: Path) -> Path:
    path = tmp_path / "cloud.ply"
    box_cloud(1500, top=True).save(path)
    return path


def test_a_cloud_in_millimetres_is_refused_with_the_command_that_scales_it(tmp_path: Path) -> None:
    cloud = box_cloud(30, top=False)
    Contacts(1e3 * cloud.points, cloud.normals).save(tmp_path / "cloud.csv")
    config = RunConfig("box", cloud=str(tmp_path / "cloud.csv"))
    with pytest.raises(InvalidContactsError, match=r"mm \(then .* in lis-grasp estimate.*`cloud`"):
        _ = Scenario.from_config(config).agent.cloud_contacts


def test_each_file_keeps_its_noise_or_gets_its_own(tmp_path: Path) -> None:
    cloud, touches = box_cloud(300, top=False, noise=0.003), box_cloud(60, top=False, noise=2e-4)
    cloud.save(tmp_path / "cloud.ply")
    touches.save(tmp_path / "touches.csv")
    known = replace(touches.subset([0, 1]), position_noise=[0.004, np.nan])
    known.save(tmp_path / "known.csv")
    paths = [tmp_path / name for name in ("cloud.ply", "touches.csv", "known.csv")]
    joined = join_sources(map(ContactSource, paths))
    assert len(joined) == 362
    # Estimated from each file alone: within the factor that estimates keep.
    assert joined.position_noise[0] == pytest.approx(0.003, rel=0.5)
    assert joined.position_noise[300] == pytest.approx(2e-4, rel=0.5)
    # Two contacts do not determine their noise.
    np.testing.assert_array_equal(joined.position_noise[360:], [0.004, np.nan])
    given = join_sources(ContactSource(path, position_noise=0.002) for path in paths)
    np.testing.assert_array_equal(
        given.position_noise[[0, 300, 360, 361]], [2e-3, 2e-3, 4e-3, 2e-3]
    )


def test_the_noise_that_a_file_s_header_records_is_that_of_its_contacts(tmp_path: Path) -> None:
    path = tmp_path / "contacts.ply"
    box_cloud(60, top=False).save(path, header='lis_grasp {"position_noise": 0.002}')
    contacts = load_source(ContactSource(path))
    np.testing.assert_array_equal(contacts.position_noise, np.full(60, 0.002))
    assert contacts.normal_noise[0] == pytest.approx(TILT, rel=0.5)


@pytest.mark.slow
def test_one_kind_of_noise_leaves_the_other_to_be_estimated(tmp_path: Path) -> None:
    path = tmp_path / "cloud.csv"
    box_cloud(300, top=False).save(path)
    exact = load_source(ContactSource(path, position_noise=0.0))
    np.testing.assert_array_equal(exact.position_noise, 0.0)
    assert exact.normal_noise == pytest.approx(TILT, rel=0.5)
    sensor = TactileSensor(position_noise=0.001)
    surface = Perception(sensor=sensor).make(Contacts.load(path))
    both = TactileSensor(position_noise=0.001, normal_noise=TILT)
    known = Perception(sensor=both).make(Contacts.load(path))
    points = 1.02 * Contacts.load(path).points
    apart = surface.evaluate(points) - known.evaluate(points)
    assert np.sqrt(np.mean(apart**2)) < 0.001


@pytest.mark.slow
def test_a_cloud_and_touches_are_estimated_together(tmp_path: Path) -> None:
    box_cloud(600, top=True).save(tmp_path / "cloud.ply")
    touches = box_cloud(80, top=False, noise=0.0)
    lower = touches.subset(touches.points[:, 2] < 0.0)
    lower.save(tmp_path / "touches.csv")
    files = [str(tmp_path / "cloud.ply"), str(tmp_path / "touches.csv")]
    assert main(["estimate", *files, "--estimator", "gpis"]) == 0
    together = load_surface(tmp_path / "surface.ply")
    truth = shapes.find("box", size=None).mesh

    def rms_error(mesh: trimesh.Trimesh) -> float:
        points = trimesh.sample.sample_surface(truth, 1000, seed=1)[0]
        return float(np.sqrt(np.mean(distances_to_mesh(points, mesh)[0] ** 2)))

    error = rms_error(together)
    for file in files:
        assert main(["estimate", file, "--estimator", "gpis"]) == 0
        assert error < 0.7 * rms_error(load_surface(tmp_path / "surface.ply"))


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["spread", "uncertainty"])
def test_touches_go_where_the_cloud_lacks_the_surface(upper_half: Path, policy: str) -> None:
    shape = shapes.find("box", size=None)
    config = RunConfig(
        prober="kinematic", estimator="gpis", policy=policy, touches=6, cloud=str(upper_half)
    )
    exploration = pipeline.touch(pipeline.Scenario.from_config(config, shape))
    middle = shape.mesh.bounds.mean(axis=0)[2]
    assert len(exploration.contacts) == 6
    assert (exploration.contacts.points[:, 2] < middle).all()


@pytest.mark.slow
def test_explore_keeps_touches_and_cloud_and_resumes(upper_half: Path, tmp_path: Path) -> None:
    options = [
        *("explore", "box", "--prober", "kinematic", "--estimator", "gpis", "--touches", "4"),
        *("--cloud", str(upper_half)),
    ]
    assert main([*options, "--output", str(tmp_path / "a")]) == 0
    outcomes = load_outcomes(tmp_path / "a" / "touches.jsonl")
    touched = np.vstack([outcome.contacts.points for outcome in outcomes])
    contacts = Contacts.load(tmp_path / "a" / "contacts.ply")
    cloud = Contacts.load(upper_half)
    np.testing.assert_array_equal(contacts.points[:4], touched[:4])
    np.testing.assert_array_equal(contacts.points[4:], cloud.points)
    np.testing.assert_array_equal(np.isnan(contacts.position_noise[:4]), True)
    assert contacts.position_noise[4] == pytest.approx(NOISE, rel=0.5)

    # Interrupted after two probes: header and two lines are left.
    log = (tmp_path / "a" / "touches.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "touches.jsonl").write_bytes(b"".join(log[:3]))
    assert main([*options, "--output", str(tmp_path / "b")]) == 0
    for name in ("touches.jsonl", "contacts.ply"):
        assert (tmp_path / "b" / name).read_bytes() == (tmp_path / "a" / name).read_bytes()


@pytest.mark.slow
def test_a_cloud_of_other_content_starts_from_the_beginning(
    upper_half: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [
        *("explore", "box", "--prober", "kinematic", "--estimator", "gpis", "--touches", "2"),
        *("--cloud", str(upper_half), "--output", str(tmp_path)),
    ]
    assert main(options) == 0
    log = tmp_path / "touches.jsonl"
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:2]))
    box_cloud(1400, top=True).save(upper_half)
    assert main(options) == 0
    assert "starting from the beginning: cloud.ply was edited" in capsys.readouterr().out


@pytest.mark.by_default("stable")
@pytest.mark.parametrize("pose", ["stable", "upright"])
def test_a_cloud_may_be_of_an_object_at_a_place_that_only_its_region_bounds(
    upper_half: Path, tmp_path: Path, pose: str
) -> None:
    task = Task.of("box", hand="wsg50", known=False, pose=pose, prober="kinematic", touches=2)
    X_WO = Scenario.from_config(task).truth.X_WO
    in_W = Contacts.load(upper_half).in_frame(np.linalg.inv(X_WO))
    in_W.save(tmp_path / "in_W.ply")
    scenario = Scenario.from_config(task.having(cloud=str(tmp_path / "in_W.ply")))
    exploration = touch(scenario)
    distances, _ = distances_to_mesh(exploration.contacts.points, scenario.truth.shape.mesh)
    assert exploration.made == 2
    assert distances.max() < 6.0 * task.robot.position_noise


def test_a_missing_cloud_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explore", "box", "--cloud", "absent.ply"]) == 2
    message = capsys.readouterr().err
    assert "absent.ply" in message
    assert message.count("\n") == 1


def test_the_noise_of_a_source_is_that_of_its_surface(tmp_path: Path) -> None:
    box_cloud(30, top=False).save(tmp_path / "contacts.ply")
    source = ContactSource(tmp_path / "contacts.ply", position_noise=0.002)
    made = pipeline.estimate_file([source], tmp_path / "noisy", estimator="gpis")
    assert read_facts(made.path)["position_noise"] == 0.002
