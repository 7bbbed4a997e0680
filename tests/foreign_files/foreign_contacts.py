"""Contacts on an ellipsoid as other programs write them, each with its truth."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from foreign import Outcome, outcome_of

from lis_grasp import Contacts
from lis_grasp.surfaces import load_contacts
from lis_grasp.typing import FloatArray

AXES = np.array([0.04, 0.03, 0.05])
COUNT = 60
_POINTS = ("{}", "pos_{}", "p{}", "position.{}", "point_{}", "contact_{}", "{} [m]")
_NORMALS = ("n{}", "normal_{}", "n_{}", "scalar_n{}", "Normals_{}")
_SCALES = {"m": 1.0, "mm": 1e3, "cm": 1e2, "inch": 1 / 0.0254}


def truth() -> tuple[FloatArray, FloatArray]:
    """Return the points and outward normals."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(COUNT, 3))
    points = AXES * directions / np.linalg.norm(directions, axis=1)[:, None]
    normals = points / AXES**2
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def check_contacts(folder: Path, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield what becomes of a file as it is, and with what its user knows."""
    points, normals = truth()
    unit = str(rng.choice(list(_SCALES)))
    stated = bool(rng.random() < 0.5)
    inward = bool(rng.random() < 0.2)
    side = -normals if inward else normals
    write = rng.choice([_csv, _ply, _npy, _text])
    path, says = write(folder, points * _SCALES[unit], side, unit if stated else "", rng)

    def is_right(contacts: Contacts) -> bool:
        if len(contacts) != COUNT:
            return False
        order = np.lexsort(np.round(contacts.points, 6).T)
        true = np.lexsort(np.round(points, 6).T)
        # Files have six digits at least.
        return bool(
            np.allclose(contacts.points[order], points[true], atol=2e-6)
            and np.allclose(contacts.normals[order], normals[true], atol=1e-3)
        )

    yield "bare", outcome_of(lambda: load_contacts(path), is_right)
    known: dict[str, Any] = {} if says else {"units": unit}
    known |= {"normals": "inward"} if inward else {}
    yield "known", outcome_of(lambda: load_contacts(path, **known), is_right)


def _csv(
    folder: Path, points: FloatArray, normals: FloatArray, unit: str, rng: np.random.Generator
) -> tuple[Path, bool]:
    pattern, ending = str(rng.choice(_POINTS)), f"_{unit}" if rng.random() < 0.5 else f" ({unit})"
    if unit:
        pattern = pattern.removesuffix(" [m]") + ending
    elif pattern.endswith(" [m]"):
        pattern = "{}"
    columns = {pattern.format(a): points[:, k] for k, a in enumerate("xyz")}
    pattern = str(rng.choice(_NORMALS))
    columns |= {pattern.format(a): normals[:, k] for k, a in enumerate("xyz")}
    for name in rng.choice(["id", "r", "intensity", "label"], size=2, replace=False):
        columns[str(name)] = np.arange(len(points), dtype=float)
    names = [str(name) for name in rng.permutation(list(columns))]
    mark = str(rng.choice([",", ";", "\t", ", "]))
    lines = [mark.join(names)]
    for row in zip(*(columns[name] for name in names), strict=True):
        lines.append(mark.join(f"{value:.9g}" for value in row))
    if rng.random() < 0.3:
        lines.insert(0, "# written by a scanner")
    text = str(rng.choice(["\n", "\r\n"])).join(lines)
    path = folder / "c.csv"
    path.write_bytes(text.encode(str(rng.choice(["utf-8", "utf-8-sig"]))))
    return path, bool(unit)


def _ply(
    folder: Path, points: FloatArray, normals: FloatArray, unit: str, rng: np.random.Generator
) -> tuple[Path, bool]:
    table = np.hstack([points, normals])
    order = rng.permutation(6)
    names = [("x", "y", "z", "nx", "ny", "nz")[k] for k in order]
    kind = str(rng.choice(["ascii", "binary_little_endian", "binary_big_endian"]))
    head = ["ply", f"format {kind} 1.0", "comment by a scanner", f"element vertex {len(points)}"]
    head += [*(f"property double {name}" for name in names), "property uchar red", "end_header"]
    body = io.BytesIO()
    if kind == "ascii":
        for row in table[:, order]:
            body.write((" ".join(f"{value:.9g}" for value in row) + " 7\n").encode())
    else:
        mark = "<" if "little" in kind else ">"
        rows = np.zeros(len(points), dtype=[("v", f"{mark}f8", 6), ("red", "u1")])
        rows["v"] = table[:, order]
        body.write(rows.tobytes())
    path = folder / "c.ply"
    path.write_bytes("\n".join(head).encode() + b"\n" + body.getvalue())
    return path, False


def _npy(
    folder: Path, points: FloatArray, normals: FloatArray, unit: str, rng: np.random.Generator
) -> tuple[Path, bool]:
    table = np.hstack([points, normals])
    if rng.random() < 0.5:
        path = folder / "c.npz"
        np.savez(path, points=points.astype(str(rng.choice(["f4", "f8"]))), normals=normals)
    else:
        path = folder / "c.npy"
        np.save(path, np.asfortranarray(table) if rng.random() < 0.5 else table)
    return path, False


def _text(
    folder: Path, points: FloatArray, normals: FloatArray, unit: str, rng: np.random.Generator
) -> tuple[Path, bool]:
    path = folder / str(rng.choice(["c.xyz", "c.txt", "c.pts"]))
    rows = [
        " ".join(f"{value:.9g}" for value in row) for row in np.hstack([points, normals]).tolist()
    ]
    if path.suffix == ".pts":
        rows.insert(0, str(len(points)))
    path.write_text("\n".join(rows) + "\n")
    return path, False
