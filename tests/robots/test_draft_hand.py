"""Drafts of the shipped hands from their URDF alone, compared with what was written by hand."""

import re
import shlex
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidHandError
from lis_grasp.robots._build_model import read_description
from lis_grasp.robots.draft._structure import find_fingers
from lis_grasp.robots.draft.pipeline import HandDraft, draft_hand
from lis_grasp.robots.draft.yaml_text import hand_yaml
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.robots.robot_model import joints_to
from lis_grasp.robots.shipped_models import VENDOR_HANDS, model_path


def urdf_of(name: str) -> Path:
    return model_path(f"hands/{name}/{name}.urdf")


@cache
def draft(name: str, seed: int = 0) -> HandDraft:
    return draft_hand(urdf_of(name), name=name, rng=np.random.default_rng(seed))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "wsg50",
        pytest.param("allegro", marks=pytest.mark.slow),
        pytest.param("barrett", marks=pytest.mark.slow),
    ],
)
def test_a_draft_is_healthy_and_has_the_fingers_and_pads_of_the_shipped_hand(
    name: str, tmp_path: Path
) -> None:
    made, shipped = draft(name), Hand.load(name)
    path = tmp_path / "draft.yaml"
    path.write_text(hand_yaml(made.hand, str(urdf_of(name)), made.edits, made.notes))
    hand = Hand.load(path)
    assert not [finding.text for finding in hand_findings(hand) if not finding.fine]
    assert hand.kind == shipped.kind
    assert len(hand.pads) == len(shipped.pads)

    def last_motor(of: Hand, link: str) -> str:
        moving = [j for j in joints_to(of.joints, link) if j.index >= 0]
        return moving[-1].name

    drafted = {last_motor(hand, pad.link): pad for pad in hand.pads}
    q = next(iter(shipped.pregrasps.values()))
    links = hand.forward_kinematics(np.eye(4), q)
    for pad in shipped.pads:
        own = drafted[last_motor(shipped, pad.link)]
        axis = links[own.link][:3, :3] @ own.axis_L
        X = np.linalg.inv(hand.X_LH) @ shipped.X_LH  # shipped H in drafted H
        expected = (X @ shipped.forward_kinematics(np.eye(4), q)[pad.link])[:3, :3] @ pad.axis_L
        # Both look to the closing side, give or take what the tilt to the tip's end may differ by.
        assert axis @ expected > np.cos(0.8)


@pytest.mark.slow
def test_equal_seeds_give_equal_bytes() -> None:
    again = draft_hand(urdf_of("wsg50"), name="wsg50", rng=np.random.default_rng(0))
    first, second = draft("wsg50"), again
    texts = [hand_yaml(d.hand, "wsg50.urdf", d.edits, d.notes) for d in (first, second)]
    assert texts[0] == texts[1]


@pytest.mark.slow
def test_links_without_a_mass_are_named_in_a_note(tmp_path: Path) -> None:
    urdf = tmp_path / "jaw.urdf"
    urdf.write_text(re.sub(r'<mass value="0\.\d+"/>', "", urdf_of("wsg50").read_text()))
    made = draft_hand(urdf, name="jaw", rng=np.random.default_rng(0))
    assert made.edits.repair
    assert "left_finger, right_finger" in next(note for note in made.notes if "masses" in note)
    assert not draft("wsg50").edits.repair


def test_fingers_are_the_leaf_links_of_the_shipped_hands() -> None:
    for name, count in {"allegro": 4, "wsg50": 2, "barrett": 3}.items():
        model = read_description(urdf_of(name))
        fingers = find_fingers(model)
        assert len(fingers) == count
        parents = {joint.parent for joint in model.joints if joint.kind != "fixed"}
        assert not {finger.joint.child for finger in fingers} & parents


def test_named_tips_are_the_fingers_and_unknown_ones_are_refused() -> None:
    model = read_description(urdf_of("allegro"))
    tips = [pad.link for pad in Hand.load("allegro").pads[:3]]
    assert len(find_fingers(model, tips)) == 3
    with pytest.raises(InvalidHandError, match="elbow"):
        find_fingers(model, ["elbow"])
    with pytest.raises(InvalidHandError, match="`tips`"):
        find_fingers(model, tips[:1])


def test_the_command_writes_a_yaml_and_a_page_and_keeps_existing_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    urdf = str(urdf_of("wsg50"))
    assert main(["hand", "new", urdf, "--name", "jaw"]) == 0
    said = capsys.readouterr().out
    assert "self_collision_exclusions" in said
    for pair in yaml.safe_load(Path("jaw.yaml").read_text())["self_collision_exclusions"]:
        assert "-".join(pair) in said
    written = Path("jaw.yaml").read_text()
    assert yaml.safe_load(written)["kind"] == "parallel_jaw"
    assert main(["hand", "new", urdf, "--name", "jaw"]) == 2
    assert Path("jaw.yaml").read_text() == written
    assert main(["hand", "view", "jaw.yaml"]) == 0
    assert "doctor --hand jaw.yaml" in capsys.readouterr().out
    page = Path("jaw.html").read_text()
    for posture in Hand.load("jaw.yaml").pregrasps:
        assert f"pregrasp {posture}" in page


@pytest.mark.parametrize("name", VENDOR_HANDS)
def test_a_vendors_hand_says_how_to_get_its_model(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("LIS_GRASP_MODELS", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    document = yaml.safe_load(model_path(f"hands/vendors/{name}.yaml").read_text())
    monkeypatch.setattr("sys.path", [])  # no installed wheel either
    monkeypatch.setattr("sys.prefix", "nowhere")
    monkeypatch.setenv("XDG_CACHE_HOME", "nowhere")
    with pytest.raises(InvalidHandError) as raised:
        Hand.load(name)
    assert document["model_from"] in str(raised.value)
    assert document["urdf"] in str(raised.value)
    command = shlex.split(document["model_from"])
    assert command[:2] in (["pip", "install"], ["git", "clone"])
    package = document["urdf"].split("/")[2]
    assert command[0] == "pip" or f"~/models/{package}" in command
