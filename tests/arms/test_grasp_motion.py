"""Motions for grasps, and the files that drivers play."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from made_grasps import jaw_grasp
from stations import positions_between, station_with

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.placement import home_of
from lis_grasp.arms.station import Station
from lis_grasp.arms.transit import SPEED, plan_grasp_motion
from lis_grasp.cli.main import main
from lis_grasp.grasping.grasps import LIFT
from lis_grasp.io.csv_tables import column_numbers, read_table
from lis_grasp.io.trajectory_files import write_joint_trajectory, write_trajectory_csv


@pytest.fixture(scope="module")
def station() -> Station:
    return station_with("wsg50")


def test_a_motion_leads_from_home_to_the_grasp_and_up(station: Station) -> None:
    box = trimesh.creation.box([0.05, 0.05, 0.1]).apply_translation([0.0, 0.0, 0.05])
    X_WH = np.eye(4)
    X_WH[:3, :3] = np.diag([1.0, -1.0, -1.0])  # the jaw points down
    X_WH[:3, 3] = 0.0, 0.0, 0.13
    q_open = station.hand.pregrasps["medium"]
    grasp = jaw_grasp(station.hand, np.array([0.0, 0.0, 0.07]), 0.05)
    grasp = replace(grasp, X_OH=X_WH, pregrasp_positions=q_open)
    motion = plan_grasp_motion(station, box, grasp, rng=np.random.default_rng(0))
    np.testing.assert_allclose(motion.approach.positions[0], home_of(station))
    np.testing.assert_allclose(station.palm_poses(motion.approach.positions[-1]), X_WH, atol=2e-3)
    np.testing.assert_allclose(motion.lift.positions[0], motion.approach.positions[-1])
    risen = station.palm_poses(motion.lift.positions[-1])[2, 3] - X_WH[2, 3]
    assert risen == pytest.approx(LIFT, abs=1e-3)
    checker = StationChecker(station, box)
    fine = positions_between(motion.approach, 0.005)
    assert checker.free(fine, q_open).all()  # opened, the jaw is around the box
    heights = station.palm_poses(motion.lift.positions)[:, 2, 3]
    speeds = np.abs(np.diff(heights) / np.diff(motion.lift.times))
    assert speeds.max() <= SPEED + 1e-6


def test_a_grasp_out_of_reach_has_a_reason(station: Station) -> None:
    far = jaw_grasp(station.hand, np.array([2.0, 0.0, 0.0]), 0.05)
    reason = plan_grasp_motion(station, None, far, rng=np.random.default_rng(0))
    assert reason == "out_of_arm_reach"


def test_files_keep_a_trajectory(tmp_path: Path) -> None:
    names = ("shoulder", "elbow")
    times = np.array([0.0, 0.25, 1.5])
    q = np.array([[0.0, 1.0], [0.1, -1e-9], [0.2, -3.0]])
    qd, qdd = 10.0 * q, 100.0 * q
    write_trajectory_csv(tmp_path / "a.csv", names, times, q, qd)
    header, rows = read_table(tmp_path / "a.csv")
    columns = {n: column_numbers(tmp_path / "a.csv", rows, k, n) for k, n in enumerate(header)}
    assert list(columns) == ["time", *names, "shoulder_velocity", "elbow_velocity"]
    np.testing.assert_allclose(np.column_stack([columns[n] for n in names]), q, atol=1e-6)
    np.testing.assert_allclose(columns["elbow_velocity"], qd[:, 1], atol=1e-6)
    write_joint_trajectory(tmp_path / "a.yaml", names, times, q, qd, qdd)
    message = yaml.safe_load((tmp_path / "a.yaml").read_text())
    assert message["joint_names"] == list(names)
    assert set(message) == {"header", "joint_names", "points"}
    stamps = [point["time_from_start"] for point in message["points"]]
    np.testing.assert_allclose([s["sec"] + 1e-9 * s["nanosec"] for s in stamps], times)
    assert all(0 <= s["nanosec"] < 10**9 for s in stamps)
    for key, values in (("positions", q), ("velocities", qd), ("accelerations", qdd)):
        np.testing.assert_allclose([p[key] for p in message["points"]], values, atol=1e-6)
    assert "-0.000000" not in (tmp_path / "a.yaml").read_text()


@pytest.mark.slow
def test_the_command_writes_motions_of_a_grasp(tmp_path: Path) -> None:
    mesh = trimesh.creation.box([0.06, 0.08, 0.12]).apply_translation([0.0, 0.0, 0.06])
    mesh.export(tmp_path / "box.stl")
    assert main(["grasp", str(tmp_path / "box.stl"), "--hand", "wsg50", "--grasps", "10"]) == 0
    grasps = str(tmp_path / "grasps.json")
    assert main(["motion", grasps, "--hand", "wsg50"]) == 0
    for part in ("approach", "close", "lift"):
        message = yaml.safe_load((tmp_path / "motion" / f"{part}.yaml").read_text())
        header, rows = read_table(tmp_path / "motion" / f"{part}.csv")
        assert "time" in header
        assert len(message["points"]) == len(rows) > 5
    assert main(["motion", grasps, "--hand", "wsg50", "--rank", "99"]) == 2
    assert main(["motion", grasps, "--rank", "1", "--hand", "barrett"]) == 2
    assert main(["motion", grasps, "--hand", "wsg50", "--base", "-3", "0", "0"]) == 1
