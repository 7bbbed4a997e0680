"""The mass of an object that nobody gave."""

import pytest
import trimesh

from lis_grasp.exceptions import InvalidOptionError, LisGraspWarning
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.shapes import NAMES, default_mass, find
from lis_grasp.shapes.object_mass import note_density, require_load, ycb_masses
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task.task import Task

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


@pytest.mark.parametrize("name", NAMES)
def test_a_mass_in_grams_is_noted_and_the_same_in_kilograms_is_not(name: str) -> None:
    shape = find(name)
    mass = default_mass(shape.mesh)
    task = Task.of(name, known=True, mass=mass)
    assert Scenario.from_config(task, shape).truth.mass == mass
    with pytest.warns(LisGraspWarning, match="mass is in kg.*denser than osmium; check the unit"):
        Scenario.from_config(task.having(mass=1000.0 * mass), shape)


def test_the_densest_object_without_a_note_is_of_osmium() -> None:
    litre = trimesh.creation.box([0.1, 0.1, 0.1])
    note_density(22.5, litre)
    with pytest.warns(LisGraspWarning):
        note_density(22.7, litre)
