"""The mass of an object that nobody gave."""

import pytest
import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.shapes import default_mass
from lis_grasp.shapes.object_mass import require_load, ycb_masses

BRICK = trimesh.creation.box((0.1, 0.1, 0.1))


@pytest.mark.parametrize(
    "path",
    ["006_mustard_bottle.ply", "ycb/006_mustard_bottle.obj", "006_mustard_bottle/google_16k/a.obj"],
)
def test_a_scan_of_the_ycb_set_weighs_what_was_published(path: str) -> None:
    assert default_mass(BRICK, path) == pytest.approx(0.603)


def test_objects_of_unknown_mass_weigh_200_g_but_are_not_denser_than_aluminium() -> None:
    assert default_mass(BRICK, "999_no_such_object.ply") == 0.2
    pen = trimesh.creation.box((0.14, 0.01, 0.01))
    assert default_mass(pen, "pen") == pytest.approx(2700.0 * 14e-6)


def test_masses_of_the_ycb_set_are_those_of_household_objects() -> None:
    assert len(ycb_masses()) > 50
    assert all(0.005 < mass < 1.5 for mass in ycb_masses().values())


@pytest.mark.parametrize("friction", [0.0, 100.1, 1e9, float("nan")])
def test_friction_is_above_0_and_at_most_100(friction: float) -> None:
    LoadPrior(friction=100.0)
    for make in (lambda f: LoadPrior(friction=f), lambda f: require_load(mass=1.0, friction=f)):
        with pytest.raises(InvalidOptionError) as error:
            make(friction)
        assert error.value.option == "friction"
