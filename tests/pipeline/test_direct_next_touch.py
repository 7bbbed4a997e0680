"""`lis_grasp.next_touch` is the touch of `lis-grasp next`."""

import json
from pathlib import Path

import numpy as np
import pytest

import lis_grasp as lg
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidOptionError

CONTACTS = Path(__file__).parents[2] / "examples" / "contacts.csv"


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        ({"support_height": -0.03}, ["--support", "-0.03"]),
        ({"held": True, "policy": "uncertainty"}, ["--support", "none", "--policy", "uncertainty"]),
    ],
)
def test_it_is_the_touch_of_the_command(
    tmp_path: Path, options: dict[str, object], arguments: list[str]
) -> None:
    path = tmp_path / "next.json"
    command = ["next", str(CONTACTS), "--hand", "wsg50", "--output", str(path), *arguments]
    assert main(command) == 0
    touch = lg.next_touch(lg.load_contacts(CONTACTS), "wsg50", **options)
    written = json.loads(path.read_text(encoding="utf-8"))
    np.testing.assert_array_equal(written["target"], touch.probe.target)
    np.testing.assert_array_equal(written["X_OH"], touch.approach.X_OH)
    assert written["finger"] == touch.approach.posture.finger
    assert written["why"] == touch.why()


def test_without_contacts_a_region_says_where_the_object_is() -> None:
    nothing = lg.Contacts.empty()
    with pytest.raises(InvalidOptionError, match="size is unknown"):
        lg.next_touch(nothing, "wsg50")
    touch = lg.next_touch(nothing, "wsg50", region=(0.4, 0.4, 0.3))
    assert touch.why().startswith("there are no contacts yet")
    assert np.abs(touch.probe.end[:2]).max() <= 0.4
