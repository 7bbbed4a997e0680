"""Fuzzing cases of damaged files for every reader of the package."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from fuzzing.cases import Case, Kind, require
from fuzzing.hand_cases import check_loaded, write_hand
from fuzzing.mesh_cases import check_shape
from fuzzing.mutations import damage_bytes, damage_plain
from lis_grasp import Contacts, shapes
from lis_grasp.exploration import Probe, ProbeOutcome, TouchLog, load_outcomes
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.motion import Motion
from lis_grasp_studies.study.study import Study, load_study

Generator = np.random.Generator


def make(group: str, index: int, rng: Generator, folder: Path) -> Case:
    """Return a damaged file for one reader; half of the JSON and YAML files get damaged values."""
    name, content, check = READERS[group]
    path = folder / name
    if group.startswith("hand"):
        hand, model = write_hand(folder / "hand", group.removeprefix("hand "), rng)
        path = hand if group == "hand yaml" else model
        damaged, fault = damage_bytes(rng, path.read_bytes())
        path.write_bytes(damaged)
        return Case(f"{path.name}, {fault}", lambda: check_loaded(hand))
    whole = content()
    sound = bool(rng.random() < 0.01)
    if sound:
        damaged, fault = whole, "nothing wrong"
    elif name.endswith((".json", ".jsonl", ".yaml")) and rng.random() < 0.5:
        damaged, fault = _damage_values(rng, name, whole)
    else:
        damaged, fault = damage_bytes(rng, whole)
    path.write_bytes(damaged)
    return Case(f"{name}, {fault}", lambda: check(path), sound)


def _damage_values(rng: Generator, name: str, whole: bytes) -> tuple[bytes, str]:
    if name.endswith(".yaml"):
        plain, fault = damage_plain(rng, yaml.safe_load(whole))
        return yaml.safe_dump(plain, allow_unicode=True).encode(), fault
    if name.endswith(".json"):
        plain, fault = damage_plain(rng, json.loads(whole))
        return json.dumps(plain).encode(), fault
    lines = whole.splitlines(keepends=True)
    place = int(rng.integers(len(lines)))
    plain, fault = damage_plain(rng, json.loads(lines[place]))
    lines[place] = json.dumps(plain).encode() + b"\n"
    return b"".join(lines), fault


def _contacts() -> Contacts:
    rng = np.random.default_rng(1)
    normals = rng.standard_normal((12, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Contacts(
        0.05 * normals,
        normals,
        forces=rng.uniform(0, 1, 12),
        fingers=("thumb", "index") * 6,
        times=np.arange(12.0),
        free_points=0.1 * rng.standard_normal((4, 3)),
    )


def _saved(save: Callable[[Path], object], name: str) -> bytes:
    """Return the bytes that `save` writes."""
    import tempfile

    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / name
        save(path)
        return path.read_bytes()


_HEADER = provenance.describe(object="box", seed=0, hand="allegro")


@cache
def _contacts_ply() -> bytes:
    return _saved(lambda path: _contacts().save(path, header=_HEADER), "c.ply")


@cache
def _contacts_csv() -> bytes:
    return _saved(lambda path: _contacts().save(path), "c.csv")


def _mesh(ending: str) -> Callable[[], bytes]:
    @cache
    def content() -> bytes:
        mesh = trimesh.creation.box(extents=(0.05, 0.06, 0.07)).subdivide()
        stream = io.BytesIO()
        mesh.export(stream, file_type=ending)
        return stream.getvalue()

    return content


@cache
def _surface_ply() -> bytes:
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    mesh.vertex_attributes["uncertainty"] = np.linspace(0.0, 0.01, len(mesh.vertices))
    return _saved(lambda path: save_surface(mesh, path, header=_HEADER), "s.ply")


@cache
def _grasps_json() -> bytes:
    grasp = Grasp(
        hand="jaw",
        X_OH=np.eye(4),
        joint_names=("left", "right"),
        joint_positions=np.array([0.1, 0.2]),
        pregrasp_positions=np.array([0.2, 0.3]),
        approach_O=np.array([0.0, 0.0, -1.0]),
        contact_points=np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]),
        contact_normals=np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
        contact_fingers=("left", "right"),
        contact_forces=np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        quality={"epsilon": 0.25},
        accepted="force closure",
    )
    search = GraspSearch((grasp, grasp), {"steep": 3}, 7)
    return _saved(lambda path: search.save(path, header=_HEADER), "g.json")


@cache
def _touches_jsonl() -> bytes:
    contacts = _contacts()
    probe = Probe(np.array([0.05, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), 0.1, 0.05)

    def save(path: Path) -> None:
        log = TouchLog(path, {"object": "box", "seed": 0})
        for i in range(4):
            log.append(ProbeOutcome(probe, "touched", contacts.subset([i]), duration=1.0))
        log.append(ProbeOutcome(probe, "missed", free_points=contacts.free_points))
        log.append(ProbeOutcome(probe, "blocked", reason="out of reach"))
        log.end("as many touches as asked for")

    return _saved(save, "t.jsonl")


@cache
def _motion_npz() -> bytes:
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 2, 3] = np.linspace(0.0, 0.1, 20)
    motion = Motion(np.linspace(0, 2, 20), {"object": poses, "palm": poses})
    return _saved(motion.save, "m.npz")


@cache
def _study_yaml() -> bytes:
    facts = {
        "objects": ["box", "torus"],
        "estimators": ["gpis", "blend"],
        "touches": [10, 20],
        "noise": ["none", "1mm/3deg"],
        "hands": ["wsg50"],
        "seeds": 2,
        "reference": "gpis",
        "policy": "spread",
        "mass": 0.2,
        "friction": 0.8,
        "size": None,
        "units": "m",
        "grasps": 5,
        "prober": "kinematic",
    }
    return yaml.safe_dump(facts).encode()


def _check_contacts(path: Path) -> None:
    provenance.read(path)
    contacts = Contacts.load(path)
    require(bool(np.isfinite(contacts.points).all()), "points are finite")
    lengths = np.linalg.norm(contacts.normals, axis=1)
    require(bool(np.abs(lengths - 1.0).max(initial=0.0) < 1e-9), "normals are unit")
    again = path.with_name("again.ply")
    contacts.save(again)
    require(bool(np.array_equal(Contacts.load(again).points, contacts.points)), "saved as loaded")


def _check_surface(path: Path) -> None:
    provenance.read(path)
    mesh = load_surface(path)
    require(bool(np.isfinite(mesh.vertices).all()), "vertices are finite")
    require(len(mesh.faces) > 0 and bool(mesh.faces.max() < len(mesh.vertices)), "faces are there")
    save_surface(mesh, path.with_name("again.ply"))


def _check_grasps(path: Path) -> None:
    provenance.read(path)
    search = GraspSearch.load(path)
    for grasp in search.grasps:
        require(bool(np.isfinite(grasp.X_OH).all()), "poses are finite")
        require(all(isinstance(f, str) for f in grasp.contact_fingers), "fingers have names")
    search.save(path.with_name("again.json"))


def _check_touches(path: Path) -> None:
    outcomes = load_outcomes(path)
    for outcome in outcomes:
        require(bool(np.isfinite(outcome.contacts.points).all()), "contacts are finite")
        require(isinstance(outcome.reason, str), "reasons are text")
        require(isinstance(outcome.moved, float | int), "moved is a number")
        require(bool(np.isfinite(outcome.moved)), "moved is finite")
    known = TouchLog(path, {"object": "box", "seed": 0}).resume()
    require(len(known) <= len(outcomes), "no outcome is invented")


def _check_motion(path: Path) -> None:
    motion = Motion.load(path)
    for poses in motion.poses.values():
        require(bool(np.isfinite(poses).all()), "poses are finite")
    motion.save(path.with_name("again.npz"))


def _check_study(path: Path) -> None:
    study = Study.from_facts(load_study(path))
    require(len(study.trials()) > 0, "there are trials")
    Study.from_facts(study.facts())


READERS: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], None]]] = {
    "contacts.ply": ("contacts.ply", _contacts_ply, _check_contacts),
    "contacts.csv": ("contacts.csv", _contacts_csv, _check_contacts),
    **{
        f"mesh {ending}": (
            f"mesh.{ending}",
            _mesh(ending),
            lambda path: check_shape(shapes.load(path)),
        )
        for ending in ("stl", "obj", "ply", "off", "glb")
    },
    "surface.ply": ("surface.ply", _surface_ply, _check_surface),
    "grasps.json": ("grasps.json", _grasps_json, _check_grasps),
    "touches.jsonl": ("touches.jsonl", _touches_jsonl, _check_touches),
    "motion.npz": ("motion.npz", _motion_npz, _check_motion),
    "study.yaml": ("study.yaml", _study_yaml, _check_study),
    "hand yaml": ("", bytes, check_loaded),
    "hand urdf": ("", bytes, check_loaded),
    "hand sdf": ("", bytes, check_loaded),
}


def _rows_reader() -> dict[str, Any]:
    """Return the reader of a study's rows, if pyarrow is installed."""
    try:
        import pyarrow  # noqa: F401
    except ModuleNotFoundError:
        return {}
    from lis_grasp_studies.study.study_results import StudyResults
    from lis_grasp_studies.study.study_trial import COLUMNS

    @cache
    def content() -> bytes:
        import lis_grasp

        row: dict[str, Any] = dict.fromkeys(COLUMNS)
        row |= {"key": "a" * 16, "object": "box", "version": lis_grasp.__version__, "seed": 0}

        def save(path: Path) -> None:
            results = StudyResults(path.parent)
            results.lines.append([row])
            results.write_merged()

        return _saved(save, "rows.parquet")

    def check(path: Path) -> None:
        (row,) = StudyResults(path.parent).read()
        require(isinstance(row, dict), "a row comes back")

    return {"rows.parquet": ("rows.parquet", content, check)}


READERS |= _rows_reader()

KIND = Kind(tuple(READERS), make)
