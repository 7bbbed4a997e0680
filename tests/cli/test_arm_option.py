"""The option --arm: reports, recorded bases, and stages run alone."""

import json
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io import provenance
from lis_grasp.motion import Motion, arm_body
from lis_grasp.pipeline.names_of_2 import RunConfig


@pytest.mark.slow
def test_a_run_with_an_arm_records_it_and_its_grasps_repeat(tmp_path: Path) -> None:
    run, alone = tmp_path / "run", tmp_path / "alone"
    options = ["box", "--known", "--arm", "iiwa14", "--hand", "wsg50", "--prober", "kinematic"]
    options += ["--touches", "10", "--seed", "1"]
    # One attempt and no test of a grasp: after an aborted one, the frame moves with the object.
    once = ["--grasps", "1", "--attempts", "1", "--closings", "0"]
    assert main(["run", *options, *once, "--output", str(run)]) == 0
    report = json.loads((run / "report.json").read_text())
    assert report["config"]["arm"] == report["arm"]["name"] == "iiwa14"
    use = report["lift"]["arm"]
    assert use["steps"] > 100
    assert use["effort"] < 1.0
    assert use["speed"] < 1.0
    X_EA = np.array(report["arm"]["X_EA"])
    motion = Motion.load(run / "motion.npz")
    np.testing.assert_allclose(motion.poses[arm_body("base")][0], X_EA, atol=1e-12)
    for name in ("contacts.ply", "surface.ply", "grasps.json"):
        recorded = provenance.read(run / name)
        assert recorded["arm"] == "iiwa14"
        np.testing.assert_array_equal(recorded["X_EA"], X_EA)

    assert main(["grasp", str(run / "surface.ply"), "--grasps", "1", "--output", str(alone)]) == 0
    again, first = (json.loads((folder / "grasps.json").read_text()) for folder in (alone, run))
    assert again["grasps"] == first["grasps"]
    assert again["rejections"] == first["rejections"]


def test_a_base_needs_an_arm_and_an_arm_needs_drake() -> None:
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(base=(-0.5, 0.0, 0.1))
    assert error.value.option == "base"
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(arm="iiwa14", base=(0.0, 0.0))
    assert (error.value.option, error.value.value) == ("base", (0.0, 0.0))
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(arm="iiwa14", simulator="mujoco")
    assert error.value.option == "arm"


def test_an_unknown_arm_is_one_sentence(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code = main(["run", "box", "--known", "--arm", "iiwa15", "--output", str(tmp_path / "x")])
    assert code == 2
    assert "iiwa14" in capsys.readouterr().err
