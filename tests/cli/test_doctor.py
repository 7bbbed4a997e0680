"""`lis-grasp doctor`: shipped hands are healthy, and each injected fault is named."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import yaml

from lis_grasp.cli import doctor
from lis_grasp.cli.main import main
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import _facing_gaps, hand_findings
from lis_grasp.robots.shipped_models import HAND_NAMES, model_path


@pytest.mark.parametrize("name", HAND_NAMES)
def test_shipped_hands_are_healthy(name: str) -> None:
    faults = [finding.text for finding in hand_findings(Hand.load(name)) if not finding.fine]
    assert not faults


def change_urdf(old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        urdf = folder / "allegro.urdf"
        text = urdf.read_text()
        assert old in text
        urdf.write_text(text.replace(old, new))

    return change


def change_yaml(edit: Callable[[dict], object]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        path = folder / "allegro.yaml"
        document = yaml.safe_load(path.read_text())
        edit(document)
        path.write_text(yaml.safe_dump(document))

    return change


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("allegro.urdf", "allegro.yaml"):
        (tmp_path / name).write_text((model_path("hands/allegro") / name).read_text())
    return tmp_path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (change_urdf('ixx="1.960e-05"', 'ixx="1.960e-02"'), "is impossible"),
        (change_urdf('<mass value="0.54"/>', '<mass value="540"/>'), "masses must be in kg"),
        (
            # Fingers bent into the palm.
            change_yaml(lambda d: d["pregrasps"].update(fist=[0, 1.6, 1.7, 1.6] * 3 + [0.3] * 4)),
            "links collide in pregrasp fist",
        ),
        (
            change_yaml(lambda d: d["pads"]["index"].update(center=[-0.01, 0, 0])),
            "below its link's surface",
        ),
        (
            change_yaml(lambda d: d["pads"]["index"].update(radius=0.03)),
            "outside of its link",
        ),
        (
            change_yaml(lambda d: [pad.update(axis=[0, 0, 1]) for pad in d["pads"].values()]),
            "no two or three pads face each other",
        ),
        (
            change_yaml(lambda d: d["probe_postures"]["index"].update(direction=[0, 0, -1])),
            "ahead of the tip's sphere",
        ),
        (
            change_yaml(
                lambda d: d["probe_postures"]["index"].update(
                    positions=[0, 0.5, 0.3, 0, *[0, 0, 0.6, 1.6] * 2, 0.3, 0.3, 0.3, 0.3]
                )
            ),
            "will touch flat objects first",
        ),
        (change_yaml(lambda d: d.update(max_contact_force=60)), "lower it, or check"),
        (change_urdf('effort="0.7"', 'effort="25000"'), "as large as index_0 25000 N m"),
    ],
)
def test_a_fault_of_a_hand_is_named(
    change: Callable[[Path], None],
    message: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(folder)
    assert main(["doctor", "--hand", str(folder / "allegro.yaml")]) == 1
    output = capsys.readouterr()
    faults = [line for line in output.out.splitlines() if line.startswith("FIX")]
    assert any(message in line for line in faults), output.out
    assert "must be fixed" in output.err


def test_colliding_pairs_are_printed_as_yaml_to_paste(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "allegro.yaml"
    document = yaml.safe_load(path.read_text())
    document["pregrasps"]["fist"] = [0, 1.6, 1.7, 1.6] * 3 + [0.3] * 4
    path.write_text(yaml.safe_dump(document))
    assert main(["doctor", "--hand", str(path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    pairs = yaml.safe_load("\n".join(line for line in lines if line.startswith("  - [")))
    document["self_collision_exclusions"] += pairs
    path.write_text(yaml.safe_dump(document))
    assert main(["doctor", "--hand", str(path)]) == 0


def test_repair_writes_a_copy_that_is_healthy(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change_urdf('ixx="1.960e-05"', 'ixx="1.960e-02"')(folder)
    path, copy = folder / "allegro.yaml", tmp_path / "deeper" / "copy.urdf"
    copy.parent.mkdir()
    assert main(["run", "box", "--hand", str(path), "--output", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("lis-grasp: the inertia of")
    assert "--repair" in error
    assert main(["doctor", "--hand", str(path), "--repair", str(copy)]) == 0
    document = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(document | {"urdf": "deeper/copy.urdf"}))
    assert main(["doctor", "--hand", str(path)]) == 0
    assert main(["doctor", "--repair", str(copy)]) == 2


@pytest.mark.slow
def test_this_machine_is_fit(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    output = capsys.readouterr().out
    assert "Drake can be imported" in output
    assert "15 touches of a box" in output


def test_the_urdf_of_a_hand_may_be_in_a_package(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    models = tmp_path / "far" / "models"  # not beside the file, where it would be found
    elsewhere = models / "my_hands" / "urdf"
    elsewhere.mkdir(parents=True)
    (folder / "allegro.urdf").rename(elsewhere / "allegro.urdf")
    change_yaml(lambda d: d.update(urdf="package://my_hands/urdf/allegro.urdf"))(folder)
    path = folder / "allegro.yaml"
    assert main(["doctor", "--hand", str(path)]) == 2  # not found
    for root in (models, models / "my_hands"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(root))
        assert Hand.load(path).joint_names == Hand.load("allegro").joint_names


CLAW = """<robot name="claw">
  <link name="palm">
    <inertial><mass value="0.4"/><inertia ixx="3e-4" ixy="0" ixz="0" iyy="3e-4" iyz="0" izz="3e-4"/>
    </inertial>
    <collision><geometry><box size="0.06 0.07 0.04"/></geometry></collision>
  </link>
  {fingers}
</robot>"""
FINGER = """<link name="{side}_finger">
    <inertial><mass value="0.1"/><inertia ixx="8e-5" ixy="0" ixz="0" iyy="8e-5" iyz="0" izz="4e-6"/>
    </inertial>
    <collision><origin xyz="0 0 0.05"/><geometry><cylinder radius="0.008" length="0.1"/></geometry>
    </collision>
  </link>
  <link name="{side}_tip">
    <inertial><mass value="0.01"/>
      <inertia ixx="4e-7" ixy="0" ixz="0" iyy="4e-7" iyz="0" izz="4e-7"/></inertial>
    <collision><geometry><sphere radius="0.01"/></geometry></collision>
  </link>
  <joint name="{side}" type="revolute"><parent link="palm"/><child link="{side}_finger"/>
    <origin xyz="{x} {y} 0.02"/><axis xyz="0 {turn} 0"/>
    <limit lower="-0.6" upper="1.0" effort="1.5" velocity="3"/></joint>
  <joint name="{side}_mount" type="fixed"><parent link="{side}_finger"/><child link="{side}_tip"/>
    <origin xyz="0 0 0.1"/></joint>"""


@pytest.fixture
def guide_hand(tmp_path: Path) -> str:
    """Return the file of the hand that the guide builds."""
    guide = Path(__file__).parents[2] / "docs" / "adding-a-hand.md"
    text = guide.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    (tmp_path / "claw.yaml").write_text(text)
    places = {"left": (-0.025, -0.025, -1), "right": (-0.025, 0.025, -1), "thumb": (0.025, 0, 1)}
    fingers = [FINGER.format(side=side, x=x, y=y, turn=t) for side, (x, y, t) in places.items()]
    (tmp_path / "claw.urdf").write_text(CLAW.format(fingers="".join(fingers)))
    return str(tmp_path / "claw.yaml")


def test_the_hand_of_the_guide_is_healthy(guide_hand: str) -> None:
    assert main(["doctor", "--hand", guide_hand]) == 0


@pytest.mark.slow
def test_the_hand_of_the_guide_touches_and_grasps(guide_hand: str, tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    options = ["--hand", guide_hand, "--output", out, "--touches", "30", "--prober", "kinematic"]
    options += ["--known", "--seed", "1"]
    assert main(["explore", "cylinder", *options]) == 0
    assert main(["estimate", f"{out}/contacts.ply"]) == 0
    assert main(["grasp", f"{out}/surface.ply", "--hand", guide_hand, "--grasps", "2"]) == 0
    assert GraspSearch.load(Path(out) / "grasps.json").grasps


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("import os; os.kill(os.getpid(), 11)", "signal 11"),
        ("raise RuntimeError('no EGL here')", "no EGL here"),
    ],
)
def test_a_machine_without_a_renderer_is_fit(
    program: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "_RENDERING", program)
    finding = doctor._rendering()
    assert finding.fine
    assert said in finding.text


@pytest.mark.parametrize(("tilt", "face"), [(5.0, True), (25.0, True), (35.0, False)])
def test_three_pads_around_a_ball_face_each_other(tilt: float, face: bool) -> None:
    """At 120 degrees no two are opposite; their forces balance if turned by up to 30 degrees."""
    turns = np.radians([0.0, 120.0, 240.0])
    outward = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(3)])
    axes = -np.cos(np.radians(tilt)) * outward + np.sin(np.radians(tilt)) * np.array([0, 0, 1])
    hand = SimpleNamespace(
        pads=[SimpleNamespace(half_angle=np.pi / 2, radius=0.01)] * 3,
        pad_centers=lambda X, q: np.array([0.05 * outward]),
        pad_axes=lambda X, q: np.array([axes]),
    )
    gaps = _facing_gaps(cast(Hand, hand), np.zeros((1, 3)))
    np.testing.assert_allclose(gaps, [0.08] if face else [], atol=1e-12)
