"""Objects and contacts of a protocol: frozen in one file, and how they were made."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.geometry import unit
from lis_grasp.shapes import Shape, sharp_edges
from lis_grasp_studies.evaluation.touched_shapes import touched
from lis_grasp_studies.test_objects.salted import MIXED_FAMILIES, salted_shape

FOLDER = Path(__file__).parent
"""Of the protocols, their objects and the rows of baselines."""

GUIDE = "gpis"
"""Estimator that guided the hand: one for all that are compared."""


def make_objects(salt: str, count: int, *, seed: int = 0) -> Mapping[str, Any]:
    """Return arrays of the first objects of a salt and of the contacts of each, by their names.

    Each is touched at a known place by the kinematic prober of a hand with noise, guided by
    `GUIDE`. Numbers are rounded to float32.
    """
    arrays: dict[str, Any] = {}
    for number in range(count):
        shape = salted_shape(salt, number, MIXED_FAMILIES)
        contacts = touched(shape, seed, estimator=GUIDE)
        arrays[f"{number} {shape.name}"] = np.asarray(shape.mesh.vertices, np.float32)
        arrays[f"{number} faces"] = np.asarray(shape.mesh.faces, np.uint16)
        arrays[f"{number} contacts"] = np.hstack([contacts.points, contacts.normals]).astype(
            np.float32
        )
    return arrays


def digest_of_arrays(arrays: Mapping[str, Any]) -> str:
    """Return a hash of arrays with their names, which does not depend on the file's compression."""
    found = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        found.update(array.tobytes())
    return found.hexdigest()[:16]


@lru_cache(maxsize=2)
def stored_objects(version: int) -> Mapping[str, Any]:
    """Return the arrays of a protocol's file.

    Raises `InvalidFileError` if it is missing or cannot be read.
    """
    path = FOLDER / f"objects_{version}.npz"
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except (OSError, ValueError) as error:
        raise InvalidFileError.of(path, f"must have the objects of the protocol: {error}") from None


@lru_cache(maxsize=4)
def stored_object(version: int, number: int) -> tuple[Shape, Contacts]:
    """Return an object of a protocol in its frame O, and its contacts in the order of touches."""
    arrays = stored_objects(version)
    prefix = f"{number} "
    (name,) = [key.removeprefix(prefix) for key in arrays if key.startswith(prefix) and "-" in key]
    vertices = arrays[prefix + name].astype(np.float64)
    faces = arrays[prefix + "faces"].astype(np.int64)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    rows = arrays[prefix + "contacts"].astype(np.float64)
    return Shape(name, mesh, sharp_edges(mesh)), Contacts(rows[:, :3], unit(rows[:, 3:]))
