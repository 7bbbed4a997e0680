"""The robot of a task: its sensor has the options of its group, and they reach an exploration."""

import numpy as np
import pytest

import lis_grasp as lg
from lis_grasp.cli.main import build_parser
from lis_grasp.cli.options import configure_touch
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import TactileSensor
from lis_grasp.exploration.touch_detection import APPROACH_NOISE
from lis_grasp.io.option import options_of
from lis_grasp.task.option_groups import SENSOR


def test_every_option_of_the_sensor_is_one_of_the_robot() -> None:
    names = [name for name, option in options_of(lg.Robot).items() if option.group == SENSOR]
    robot = lg.Robot(miss_rate=0.25, false_rate=0.5)
    assert {name: getattr(robot.sensor, name) for name in names} == {
        name: getattr(robot, name) for name in names
    }
    asked = configure_touch(build_parser("run").parse_args(["run", "box", "--miss-rate", "0.25"]))
    assert asked.robot.sensor.miss_rate == 0.25
    with pytest.raises(InvalidOptionError) as error:
        lg.Robot(false_rate=1.5)
    assert (error.value.option, error.value.value) == ("false_rate", 1.5)


@pytest.mark.slow
def test_a_sensor_that_misses_each_contact_finds_none_and_one_that_misses_half_needs_more() -> None:
    how = {"known": True, "prober": "kinematic", "touches": 8, "hand": "wsg50"}
    counts = {}
    for rate in (0.0, 0.5, 1.0):
        explored = lg.explore("box", miss_rate=rate, **how)
        counts[rate] = len(explored.outcomes), explored.made
    assert counts[0.0][1] == counts[0.5][1] == 8
    assert counts[1.0][1] == 0
    assert counts[0.5][0] > counts[0.0][0]


def test_false_touches_are_where_the_hand_was() -> None:
    how = {"known": True, "prober": "kinematic", "touches": 12, "hand": "wsg50"}
    explored = lg.explore("sphere", false_rate=1.0, **how)
    true = lg.shapes.find("sphere").mesh
    apart = np.abs(np.linalg.norm(explored.contacts.points - true.center_mass, axis=1))
    assert "missed" not in {outcome.status for outcome in explored.outcomes}
    assert np.all(apart < 0.3)


@pytest.mark.slow
def test_a_switch_reports_contacts_against_the_probe_with_the_noise_of_such_normals() -> None:
    how = {"known": True, "prober": "kinematic", "touches": 10, "hand": "wsg50"}
    explored, measured = (lg.explore("sphere", reports=r, **how) for r in ("touch", "normals"))
    for outcome in explored.outcomes:
        for normal in outcome.contacts.normals:
            np.testing.assert_array_equal(normal, -outcome.probe.direction)
    np.testing.assert_array_equal(explored.contacts.normal_noise, APPROACH_NOISE)
    center = lg.shapes.find("sphere").mesh.center_mass
    radius = np.linalg.norm(explored.contacts.points - center, axis=1)
    expected = np.linalg.norm(measured.contacts.points - center, axis=1).mean()
    np.testing.assert_allclose(radius, expected, rtol=0.01)  # points are measured as before
    outward = (explored.contacts.points - center) / radius[:, None]
    angles = np.arccos(np.sum(outward * explored.contacts.normals, axis=1).clip(-1.0, 1.0))
    assert angles.max() > 1e-3  # a probe does not meet a ball along its normal
    with pytest.raises(InvalidOptionError) as error:
        TactileSensor(reports="forces")  # type: ignore[arg-type]
    assert error.value.option == "reports"
