"""The doctor: shipped hands are healthy, and each fault put into one is named."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from lis_grasp.cli.main import main
from lis_grasp.grasping.hand import HAND_NAMES, Hand
from lis_grasp.grasping.hand_check import check_hand
from lis_grasp.model_files import model_path


@pytest.mark.parametrize("name", HAND_NAMES)
def test_shipped_hands_are_healthy(name: str) -> None:
    faults = [finding.text for finding in check_hand(Hand.load(name)) if not finding.fine]
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
        (change_urdf('ixx="1.960e-05"', 'ixx="1.960e-02"'), "is that of no body"),
        (change_urdf('<mass value="0.54"/>', '<mass value="540"/>'), "masses are in kg"),
        (
            # Fingers bent until they run into the palm.
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
            "no two pads face each other",
        ),
        (
            change_yaml(lambda d: d["probe_postures"]["index"].update(direction=[0, 0, -1])),
            "ahead of the tip's sphere",
        ),
        (
            change_yaml(
                lambda d: d["probe_postures"]["index"].update(positions=[0] * 12 + [0.3] * 4)
            ),
            "will touch flat objects first",
        ),
        (change_yaml(lambda d: d.update(max_contact_force=60)), "lower it, or check"),
    ],
)
def test_a_fault_is_named_with_what_to_mend(
    change: Callable[[Path], None],
    message: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(folder)
    assert main(["doctor", "--hand", str(folder / "allegro.yaml")]) == 1
    output = capsys.readouterr()
    mended = [line for line in output.out.splitlines() if line.startswith("MEND")]
    assert any(message in line for line in mended), output.out
    assert "must be mended" in output.err


def test_this_machine_is_fit(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    output = capsys.readouterr().out
    assert "Drake can be imported" in output
    assert "15 touches of a box" in output


def test_a_hand_s_urdf_may_lie_in_a_package(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "models" / "my_hands" / "urdf"
    elsewhere.mkdir(parents=True)
    (folder / "allegro.urdf").rename(elsewhere / "allegro.urdf")
    change_yaml(lambda d: d.update(urdf="package://my_hands/urdf/allegro.urdf"))(folder)
    path = folder / "allegro.yaml"
    assert main(["doctor", "--hand", str(path)]) == 2  # not found
    for root in (tmp_path / "models", tmp_path / "models" / "my_hands"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(root))
        assert Hand.load(path).joint_names == Hand.load("allegro").joint_names
