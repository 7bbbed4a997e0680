"""Meshes of a bracket as other programs write them, each with its truth."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from foreign import Outcome, outcome_of

from lis_grasp import shapes
from lis_grasp.shapes import Shape

_SCALES = {"m": 1.0, "mm": 1e3, "cm": 1e2, "inch": 1 / 0.0254}
_FORMATS = ("stl", "stl_ascii", "obj", "ply", "off", "glb", "3mf", "obj_groups")


@cache
def bracket() -> trimesh.Trimesh:
    """Return an L of 60 x 50 x 90 mm, off its frame's origin."""
    foot = trimesh.creation.box([0.06, 0.05, 0.012])
    foot.apply_translation([0.0, 0.01, 0.006])
    wall = trimesh.creation.box([0.014, 0.05, 0.09])
    wall.apply_translation([-0.023, 0.01, 0.045])
    return trimesh.boolean.union([foot, wall])


def check_mesh(folder: Path, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield what becomes of a mesh as it is, and with what its user knows."""
    true = bracket()
    kind, unit = str(rng.choice(_FORMATS)), str(rng.choice(list(_SCALES)))
    up = "y" if rng.random() < 0.3 and kind not in ("glb", "3mf") else "z"
    mesh = true.copy()
    if up == "y" or kind == "glb":  # glTF is y up
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    stated = kind in ("glb", "3mf")
    unit = {"glb": "m", "3mf": "mm"}.get(kind, unit)
    mesh.apply_scale(_SCALES[unit])
    if rng.random() < 0.3:
        mesh.invert()
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    faces = np.array([np.roll(face, int(rng.integers(3))) for face in faces])
    mesh = trimesh.Trimesh(mesh.vertices, faces, process=False)
    if rng.random() < 0.3:  # every vertex once for each face
        mesh.unmerge_vertices()
    path = _write(folder, kind, mesh, rng)

    def is_right(shape: Shape) -> bool:
        found = shape.mesh
        # STL has single precision, texts six digits.
        return bool(
            abs(found.volume / true.volume - 1.0) < 1e-4
            and np.allclose(found.center_mass, true.center_mass, atol=1e-5)
            and found.is_watertight
        )

    known: dict[str, Any] = {} if stated else {"units": unit, "up": up}
    # The axis that points up is not in such a file: a turned object is right in its own frame.
    bare = shapes.load if up == "z" else None
    if bare is not None:
        yield "bare", outcome_of(lambda: bare(path), is_right)
    yield "known", outcome_of(lambda: shapes.load(path, **known), is_right)


def _write(folder: Path, kind: str, mesh: trimesh.Trimesh, rng: np.random.Generator) -> Path:
    if kind == "obj_groups":
        return _groups(folder / "m.obj", mesh, rng)
    ending = kind.partition("_")[0]
    path = folder / f"m.{ending}"
    if kind == "ply":
        encoding = str(rng.choice(["ascii", "binary"]))
        path.write_bytes(mesh.export(file_type="ply", encoding=encoding))
        return path
    mesh.export(path, file_type=kind)
    if ending in ("obj", "off") or kind == "stl_ascii":
        text = path.read_bytes().replace(b"\r\n", b"\n")
        path.write_bytes(text.replace(b"\n", b"\r\n") if rng.random() < 0.5 else text)
    return path


def _groups(path: Path, mesh: trimesh.Trimesh, rng: np.random.Generator) -> Path:
    """Write an OBJ with a comment, groups, and numbers of vertices from the end or the start."""
    back = rng.random() < 0.5
    count = len(mesh.vertices)
    lines = ["# by a modeller", "mtllib none.mtl", "o bracket"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g} 0.5 0.5 0.5" for x, y, z in mesh.vertices]
    lines += ["vn 0 0 1", "g side", "s off", "usemtl steel"]
    for face in mesh.faces:
        numbers = [int(v) - count if back else int(v) + 1 for v in face]
        lines.append("f " + " ".join(f"{number}//1" for number in numbers))
    path.write_text("\n".join(lines) + "\n")
    return path
