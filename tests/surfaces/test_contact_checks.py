"""Whether normals point outward, as far as contacts show it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from lis_grasp import Contacts, estimate, extract_mesh, load_contacts, pipeline, shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError, LisGraspWarning
from lis_grasp.io.surface_files import load_surface
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp.surfaces.contact_checks import (
    doubt_of_low_table,
    doubt_of_table,
    fraction_in_front,
    require_outward_normals,
)
from lis_grasp.task.recorded_facts import read_facts
from lis_grasp_studies.test_objects.shape_sets import TEST_OBJECTS, graspable_shape

AXES = np.vstack([np.eye(3), -np.eye(3)])


def flipped(contacts: Contacts) -> Contacts:
    return replace(contacts, normals=-contacts.normals)


def is_refused(contacts: Contacts) -> bool:
    try:
        require_outward_normals(contacts)
    except InvalidContactsError:
        return True
    return False


@pytest.mark.parametrize("count", [4, 6])
def test_inward_normals_in_balance_are_refused(count: int) -> None:
    # Faces of a cube, all or without top and bottom: the normals sum to exactly 0.
    normals = AXES[[0, 1, 3, 4, 2, 5][:count]]
    contacts = Contacts(0.03 * normals, normals)
    require_outward_normals(contacts)
    assert fraction_in_front(contacts) == 0.0
    assert fraction_in_front(flipped(contacts)) == 1.0
    assert is_refused(flipped(contacts))


def test_contacts_of_one_view_do_not_show_the_side() -> None:
    bowl = trimesh.creation.icosphere(radius=0.05).vertices
    bowl = np.asarray(bowl[bowl[:, 2] < -0.005])
    inside = Contacts(bowl, -bowl / np.linalg.norm(bowl, axis=1, keepdims=True))
    assert fraction_in_front(inside) == 0.0
    assert not is_refused(inside)
    assert not is_refused(flipped(inside))


def test_an_estimate_refuses_inward_normals_as_a_file_does(tmp_path: Path) -> None:
    normals = AXES
    outward = Contacts(0.03 * normals, normals)
    flipped(outward).save(tmp_path / "contacts.csv")
    for refused in (
        lambda: estimate(flipped(outward), "gpis"),
        lambda: load_contacts(tmp_path / "contacts.csv"),
    ):
        with pytest.raises(InvalidContactsError) as error:
            refused()
        assert error.value.field == "normals"
    assert main(["estimate", str(tmp_path / "contacts.csv")]) == 2
    given, turned = estimate(outward, "gpis"), estimate(flipped(outward), "gpis", normals="inward")
    places = np.random.default_rng(0).uniform(-0.05, 0.05, (50, 3))
    np.testing.assert_array_equal(given.evaluate(places), turned.evaluate(places))


class InsideOut(GaussianProcessImplicitSurface):
    def evaluate(self, points: npt.ArrayLike) -> np.ndarray:
        return -super().evaluate(points)


class Inward(GaussianProcessImplicitSurface):
    def gradient(self, points: npt.ArrayLike) -> np.ndarray:
        return -super().gradient(points)


def test_stages_check_contacts_of_ones_own() -> None:
    inward = flipped(Contacts(0.03 * AXES, AXES))
    with pytest.raises(InvalidContactsError):
        pipeline.estimate(pipeline.Perception(estimator="gpis"), inward)


def test_a_warning_names_the_line_that_called_the_package() -> None:
    with pytest.warns(LisGraspWarning) as told:
        estimate(Contacts(0.03 * AXES, AXES), "gpis")
    assert {warning.filename for warning in told} == {__file__}


@pytest.mark.parametrize("kind", [InsideOut, Inward])
@pytest.mark.parametrize("by_name", [True, False])
def test_an_estimator_of_the_wrong_sign_is_refused(kind: type, by_name: bool) -> None:
    estimator = f"{__name__}:{kind.__name__}" if by_name else kind.from_contacts
    with pytest.raises(InvalidOptionError) as error:
        estimate(Contacts(0.03 * AXES, AXES), estimator)
    assert error.value.option == "estimator"


def test_contacts_below_a_table_are_told() -> None:
    contacts = Contacts(0.03 * AXES, AXES)
    assert doubt_of_table(contacts, -0.03) == doubt_of_table(contacts, None) == ""
    with pytest.warns(LisGraspWarning) as told:
        estimate(contacts, "gpis", table=0.0)
    assert doubt_of_table(contacts, 0.0) in {str(warning.message) for warning in told}


def test_a_table_far_below_all_contacts_is_told() -> None:
    """Far is more than the 60 mm between opposite contacts; the lowest is at z = -30 mm."""
    contacts = Contacts(0.03 * AXES, AXES)
    assert doubt_of_low_table(contacts, -0.089) == doubt_of_low_table(contacts, None) == ""
    assert "61 mm below all contacts" in doubt_of_low_table(contacts, -0.091)
    both = contacts.append(Contacts(0.02 * AXES, AXES))
    with pytest.warns(LisGraspWarning) as told:
        estimate(both, "gpis", table=-0.091)
    assert doubt_of_low_table(both, -0.091) in {str(warning.message) for warning in told}


@pytest.fixture
def bottle(tmp_path: Path) -> Path:
    """Return contacts of a cylinder on the table z = 0, none of them on its underside."""
    mesh = shapes.find("cylinder").mesh.copy()
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2]])
    points, faces = trimesh.sample.sample_surface(mesh, 80, seed=0)
    normals = mesh.face_normals[faces]
    touched = normals[:, 2] > -0.5
    Contacts(points[touched], normals[touched]).save(tmp_path / "contacts.csv")
    return tmp_path / "contacts.csv"


@pytest.mark.slow
def test_the_command_closes_an_estimate_at_the_table_as_python_does(bottle: Path) -> None:
    assert main(["estimate", str(bottle), "--support", "0"]) == 0
    mesh = load_surface(bottle.with_name("surface.ply"))
    own = extract_mesh(estimate(load_contacts(bottle), table=0.0))
    assert mesh.bounds[0, 2] > -1e-4  # a tenth of a millimetre: the mesh's tolerance
    assert mesh.volume == pytest.approx(own.volume, rel=0.02)
    assert read_facts(bottle.with_name("surface.ply"))["support_height"] == 0.0
    assert main(["estimate", str(bottle), "--support", "none"]) == 0
    held = load_surface(bottle.with_name("surface.ply"))
    assert held.bounds[0, 2] < -1e-3
    assert read_facts(bottle.with_name("surface.ply")).get("support_height") is None
    assert main(["grasp", str(bottle.with_name("surface.ply")), "--grasps", "1"]) in (0, 1)


def test_noise_as_large_as_the_object_is_refused(bottle: Path) -> None:
    contacts = load_contacts(bottle)
    with pytest.raises(InvalidOptionError) as error:
        estimate(contacts, "gpis", position_noise=0.5)
    assert (error.value.option, error.value.value) == ("position_noise", 0.5)
    assert main(["estimate", str(bottle), "--position-noise", "0.5"]) == 2
    estimate(contacts[:2], "gpis", position_noise=0.5)  # two touches may be nearer than noise


@pytest.mark.slow
def test_a_search_without_a_grasp_ends_with_code_1(
    bottle: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["estimate", str(bottle), "--support", "0", "--estimator", "gpis"]) == 0
    surface = str(bottle.with_name("surface.ply"))
    top = float(load_surface(Path(surface)).bounds[1, 2])
    assert main(["grasp", surface, "--support", f"{top - 0.002}", "--hand", "wsg50"]) == 1
    assert "lis-grasp lift" not in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.slow
def test_the_side_of_normals_is_seldom_mistaken() -> None:
    # At random over the whole object, near one place, and from above, as in the documentation.
    rng = np.random.default_rng(0)
    wrong, found, total = [], 0, 0
    for name in TEST_OBJECTS:
        mesh = graspable_shape(name).mesh
        for count in (5, 6, 8, 12, 20, 40, 100, 400):
            seed = int(rng.integers(1 << 30))
            points, faces = trimesh.sample.sample_surface(mesh, 20 * max(count, 200), seed=seed)
            normals = mesh.face_normals[faces]
            nearest = np.argsort(np.linalg.norm(points - points[0], axis=1))
            above = np.flatnonzero(normals[:, 2] > -0.3)
            for index in (np.arange(len(points)), nearest[: len(points) // 3], above):
                chosen = rng.choice(index, count, replace=False)
                contacts = Contacts(points[chosen], normals[chosen])
                total += 1
                found += is_refused(flipped(contacts))
                if is_refused(contacts):
                    wrong.append((name, count))
    print(f"{total} sets: {len(wrong)} refused wrongly {wrong}, {found} inward ones refused")
    assert len(wrong) < 0.005 * total
    assert found > 0.55 * total  # flat things have most contacts on two sides
