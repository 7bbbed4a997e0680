"""Whether normals point outward, as far as contacts show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from lis_grasp import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.surfaces.contact_loading import fraction_in_front, require_outward_normals
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
