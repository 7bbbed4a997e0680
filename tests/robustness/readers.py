"""Every reader of the package: a valid file of its kind, and the check of what it reads."""

from __future__ import annotations

import base64
import importlib.util
import io
import json
import resource
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh
import yaml
from claw import SDF, YAML
from made_grasps import jaw_grasp
from PIL import Image
from random_directions import random_directions
from robots.test_mjcf_reader import HAND as MJCF
from touch_recording import record, write_bag, write_csv

import lis_grasp
from lis_grasp import Contacts, shapes
from lis_grasp.exceptions import LisGraspError
from lis_grasp.exploration import (
    Exploration,
    Observation,
    Probe,
    ProbeOutcome,
    TouchLog,
    load_observations,
)
from lis_grasp.exploration.planar_motion import PoseBelief, planar_pose
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.request_lines import answer_lines
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.logs import (
    Finger,
    LogFrames,
    TactilePatches,
    TouchDetection,
    contacts_from_log,
    contacts_from_patches,
    open_log,
)
from lis_grasp.motion import Motion
from lis_grasp.pipeline.names_of_2 import RunConfig
from lis_grasp.results.page import scene_of
from lis_grasp.results.run_results import Run
from lis_grasp.robots._build_model import build_model
from lis_grasp.robots._description import DescriptionEdits, parse_description
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.robots.kinematics import link_kinematics
from lis_grasp.robots.link_bodies import load_link_mesh
from lis_grasp.robots.shipped_models import model_path
from lis_grasp.service.touch_service import TouchService
from lis_grasp.shapes.loading import load_obstacles
from lis_grasp.shapes.placement import draw_pose
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.next_touch import ObjectPlace
from lis_grasp.surfaces import load_contacts
from lis_grasp.views import load_view, save_view
from lis_grasp.views.image_files import load_image
from lis_grasp_studies.contact_study.score import SURFACES
from lis_grasp_studies.evaluation.configuration import SHIPPED, Configuration
from lis_grasp_studies.evaluation.results import EvaluationResults
from lis_grasp_studies.study.study import Study, load_study

_LONGEST_MESSAGE = 1000  # a longer one is a dump of data
_MEMORY = 4 * 2**30  # [bytes] beyond those of the process: inputs of a few kilobytes need far less


@dataclass(frozen=True)
class Reader:
    """A kind of file: how to write a valid one into a folder, and the check of a damaged one.

    `write` returns the file to damage; its check reads it, or what it is a part of.
    """

    write: Callable[[Path], Path]
    check: Callable[[Path], object]


@contextmanager
def refused_at_most(seconds: float = 10.0) -> Iterator[None]:
    """Permit no error but one of a readable sentence, within a time of the processor and memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    start, size = time.process_time(), pages * resource.getpagesize()
    # The system ends a process that hangs: a dead worker fails the test. It counts whole seconds,
    # so one more than the start's may be over at once.
    longest = int(start + 6 * seconds) + 10
    limits = {resource.RLIMIT_AS: size + _MEMORY, resource.RLIMIT_CPU: longest}
    message = "none"
    before = {kind: resource.getrlimit(kind) for kind in limits}
    for kind, most in limits.items():
        resource.setrlimit(kind, (most, before[kind][1]))
    try:
        yield
    except LisGraspError as error:
        message = str(error)
    finally:
        for kind, limit in before.items():
            resource.setrlimit(kind, limit)
    assert message
    assert "\n" not in message
    assert len(message) <= _LONGEST_MESSAGE
    assert time.process_time() - start < seconds


_HEADER = provenance.describe(object="box", seed=0, hand="allegro")


def sphere_contacts(count: int, rng: np.random.Generator) -> Contacts:
    normals = random_directions(count, rng)
    return Contacts(0.05 * normals, normals)


def _contacts() -> Contacts:
    rng = np.random.default_rng(1)
    plain = sphere_contacts(12, rng)
    return Contacts(
        plain.points,
        plain.normals,
        forces=rng.uniform(0, 1, 12),
        fingers=("thumb", "index") * 6,
        times=np.arange(12.0),
        free_points=0.1 * rng.standard_normal((4, 3)),
    )


def _box(ending: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"mesh.{ending}"
        box = trimesh.creation.box(extents=(0.05, 0.06, 0.07)).subdivide()
        if ending != "gltf":
            box.apply_scale(1e3 if ending == "3mf" else 1.0)
            box.export(path)
            return path
        files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box))
        header = json.loads(files["model.gltf"])
        for buffer in header["buffers"]:
            content = base64.b64encode(files[buffer["uri"]]).decode()
            buffer["uri"] = f"data:application/octet-stream;base64,{content}"
        path.write_text(json.dumps(header))
        return path

    return write


def _surface(folder: Path) -> Path:
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    mesh.vertex_attributes["uncertainty"] = np.linspace(0.0, 0.01, len(mesh.vertices))
    save_surface(mesh, folder / "surface.ply", header=_HEADER)
    return folder / "surface.ply"


def _saved(name: str, save: Callable[[Path], object]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        save(folder / name)
        return folder / name

    return write


def _save_grasps(path: Path, header: str = _HEADER) -> None:
    grasp = jaw_grasp(Hand.load("wsg50"), np.zeros(3), 0.05)
    GraspSearch((grasp, grasp), {"steep": 3}, 7).save(path, header=header)


def _save_touches(path: Path) -> None:
    contacts = _contacts()
    probe = Probe(np.array([0.05, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), 0.1, 0.05)
    log = TouchLog(path, {"object": "box", "seed": 0})
    for i in range(4):
        touched = ProbeOutcome(probe, "touched", contacts.subset([i]), duration=1.0)
        log.append(Observation(touched))
    sliding, start = replace(probe, slides=[[0.0, 0.03, 0.0]]), PoseBelief.start()
    for i, belief in enumerate((start, replace(start, trust="lost"), start)):
        both = contacts.subset([4 + 2 * i, 5 + 2 * i])
        log.append(Observation(ProbeOutcome(sliding, "touched", both, slid=1), belief))
    found = replace(start, joined=planar_pose(np.array([0.01, 0.02, 0.3])))
    log.append(Observation(ProbeOutcome(probe, "touched", contacts.subset([10])), found))
    log.append(Observation(ProbeOutcome(probe, "missed", free_points=contacts.free_points)))
    log.append(Observation(ProbeOutcome(probe, "blocked", reason="out of reach")))
    log.end("as many touches as asked for")


def _save_motion(path: Path) -> None:
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 2, 3] = np.linspace(0.0, 0.1, 20)
    Motion(np.linspace(0, 2, 20), {"object": poses, "palm": poses}).save(path)


def _save_study(path: Path) -> None:
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
    path.write_text(yaml.safe_dump(facts))


def _save_rows(path: Path) -> None:
    from lis_grasp_studies.study.columns import COLUMNS
    from lis_grasp_studies.study.results import StudyResults

    row = dict.fromkeys(COLUMNS)
    row |= {"key": "a" * 16, "object": "box", "version": lis_grasp.__version__, "seed": 0}
    results = StudyResults(path.parent)
    results.lines.append([row])
    results.write_merged()
    (path.parent / "rows.jsonl").unlink()


# One body is a mesh, so that its file can be damaged too.
_SDF = SDF.replace("<pose>0.01 0 0 0 0 0.3</pose>", "").replace(
    "<box><size>0.06 0.05 0.04</size></box>",
    "<mesh><uri>body.stl</uri><scale>1 1 1</scale></mesh>",
)


def write_hand(folder: Path, model: str) -> Path:
    """Write a valid hand with a mesh; return its URDF or SDF, beside the YAML of its name."""
    trimesh.creation.box(extents=(0.06, 0.05, 0.04)).export(folder / "body.stl")
    if model == "claw":
        (folder / "claw.yaml").write_text(yaml.safe_dump(YAML))
        (folder / "claw.sdf").write_text(_SDF)
        return folder / "claw.sdf"
    for ending in (".yaml", ".urdf"):
        shutil.copy(model_path(f"hands/{model}/{model}{ending}"), folder)
    urdf = folder / f"{model}.urdf"
    box = '<box size="0.146 0.0495 0.0725"/>'
    urdf.write_text(urdf.read_text().replace(box, '<mesh filename="body.stl" scale="1 1 1"/>'))
    return urdf


def _write_yaml(folder: Path, model: str) -> Path:
    return write_hand(folder, model).with_suffix(".yaml")


# Tables of points in millimetres and normals, as other programs write them.
_NAMED = {
    "semicolons.csv": (";", "x [mm]", "y [mm]", "z [mm]", "normal_x", "normal_y", "normal_z"),
    "tabs.csv": ("\t", "Points:0_mm", "Points:1_mm", "Points:2_mm", "n_x", "n_y", "n_z"),
}


def _save_points(path: Path) -> None:
    points = 0.04 * random_directions(16, np.random.default_rng(0))
    if path.name in _NAMED:
        separator, *names = _NAMED[path.name]
        rows = [[*np.multiply(1e3, point), *point / 0.04] for point in points]
        lines = [names, *([f"{value:.6f}" for value in row] for row in rows)]
        path.write_text("".join(separator.join(line) + "\n" for line in lines))
        return
    if path.suffix in (".npy", ".npz"):
        np.save(path, points) if path.suffix == ".npy" else np.savez(path, points=points)
        return
    separator = "," if path.suffix == ".csv" else " "
    rows = [separator.join(f"{value:.6f}" for value in point) for point in points]
    names = [f"property double {axis}" for axis in "xyz"]
    heads = {
        ".csv": ["x,y,z"],
        ".off": ["OFF", "16 0 0"],
        ".pcd": ["FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "POINTS 16", "DATA ascii"],
        ".ply": ["ply", "format ascii 1.0", "element vertex 16", *names, "end_header"],
        ".pts": ["16"],
    }
    if path.suffix == ".xyzn":
        rows = [
            f"{row} {' '.join(f'{x:.6f}' for x in p / 0.04)}"
            for row, p in zip(rows, points, strict=True)
        ]
    path.write_text("\n".join([*heads.get(path.suffix, []), *rows]) + "\n")


def _save_log(path: Path) -> None:
    recording = record(touches=3)
    if path.suffix == ".csv":
        write_csv(recording, path)
        return
    kind = {".bag": "ros1", ".mcap": "mcap", ".db3": "sqlite3"}[path.suffix]
    written = write_bag(recording, path.with_name("log.bag"), kind)
    if kind != "ros1":
        next(written.glob(f"*{path.suffix}")).rename(path)


def _check_contacts(path: Path) -> None:
    provenance.read(path)
    contacts = Contacts.load(path)
    assert np.isfinite(contacts.points).all()
    assert np.abs(np.linalg.norm(contacts.normals, axis=1) - 1.0).max(initial=0.0) < 1e-9
    again = path.with_name("again.ply")
    contacts.save(again)
    assert np.array_equal(Contacts.load(again).points, contacts.points)


def check_shape(shape: shapes.Shape, given: np.ndarray | None = None) -> None:
    """Require a closed, outward mesh with a volume, no larger than the vertices in the file."""
    mesh = shape.mesh
    assert np.isfinite(mesh.vertices).all()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert np.linalg.det(mesh.triangles - mesh.vertices.mean(axis=0)).sum() > 0.0
    assert np.isfinite(shape.edges).all()
    assert all(repair and "\n" not in repair for repair in shape.repairs)
    if given is not None and np.isfinite(given).all():
        slack = 1e-4 * shape.size + 1e-6 * np.abs(given).max()
        assert (mesh.vertices >= given.min(axis=0) - slack).all()
        assert (mesh.vertices <= given.max(axis=0) + slack).all()


def _check_surface(path: Path) -> None:
    provenance.read(path)
    mesh = load_surface(path)
    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.faces) > 0
    assert mesh.faces.max() < len(mesh.vertices)
    save_surface(mesh, path.with_name("again.ply"))


def _check_grasps(path: Path) -> None:
    provenance.read(path)
    search = GraspSearch.load(path)
    for grasp in search.grasps:
        assert np.isfinite(grasp.X_OH).all()
        assert all(isinstance(finger, str) for finger in grasp.contact_fingers)
    search.save(path.with_name("again.json"))


def _check_touches(path: Path) -> None:
    observations = load_observations(path)
    for outcome in (observation.outcome for observation in observations):
        assert np.isfinite(outcome.contacts.points).all()
        assert isinstance(outcome.reason, str)
        assert np.isfinite(outcome.moved)
    explored = Exploration.replay(observations)
    assert explored.made <= len(explored.contacts) == len(explored.touches)
    recording = TouchLog(path, {"object": "box", "seed": 0}).read()
    assert len(recording.probes) <= len(observations)


def _check_motion(path: Path) -> None:
    motion = Motion.load(path)
    assert all(np.isfinite(poses).all() for poses in motion.poses.values())
    motion.save(path.with_name("again.npz"))


def _check_study(path: Path) -> None:
    study = Study.from_facts(load_study(path))
    assert len(study.trials()) > 0
    Study.from_facts(study.facts())


def _check_rows(path: Path) -> None:
    from lis_grasp_studies.study.results import StudyResults

    (row,) = StudyResults(path.parent).read()
    assert isinstance(row, dict)


def check_hand_file(path: Path) -> None:
    """Require a hand with limits in order, finite kinematics, and findings that are sentences."""
    hand = Hand.load(path.with_suffix(".yaml"))
    assert (hand.lower < hand.upper).all()
    assert np.isfinite([hand.lower, hand.upper]).all()
    assert (hand.effort_limits > 0.0).all()
    middle = 0.5 * (hand.lower + hand.upper)
    assert np.isfinite(hand.pad_centers(np.eye(4), middle)).all()
    assert np.isfinite(hand.pad_jacobians(np.eye(4), middle)[2]).all()
    poses = hand.forward_kinematics(np.eye(4), middle).values()
    turns = np.array([pose[:3, :3] for pose in poses])
    assert np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max() < 1e-6
    for inertial in hand.inertials.values():
        assert 0.0 <= inertial.mass < np.inf
        assert np.isfinite(inertial.inertia_L).all()
    for geometry in hand.link_geometries:
        assert np.isfinite(geometry.mesh.vertices).all()
        assert all(size > 0.0 for size in geometry.dimensions)
    assert all(finding.text.strip() for finding in hand_findings(hand))


def _check_points(path: Path) -> None:
    contacts = load_contacts(path)
    assert np.isfinite(contacts.points).all()
    assert contacts.normal_noise is None or (contacts.normal_noise > 0.0).all()


def _check_log(path: Path) -> None:
    touch = TouchDetection(normals="approach")
    frames = LogFrames(object_pose="object" if path.suffix == ".csv" else "/object")
    contacts, _ = contacts_from_log(open_log(path), [Finger()], frames, touch)
    assert np.isfinite(contacts.points).all()


def _save_patches(path: Path) -> None:
    y, x = 1e-4 * (np.mgrid[:40, :50] - np.array([19.5, 24.5])[:, None, None])
    depth = np.maximum(1e-3 - 10.0 * (x**2 + y**2), 0.0)
    np.savez(path, heights=depth, poses=np.eye(4)[None], pitch=1e-4)


def _check_patches(path: Path) -> None:
    contacts = contacts_from_patches(TactilePatches.load(path))
    assert np.isfinite(contacts.points).all()


def _save_requests(path: Path) -> None:
    lines = [
        {"request": "next", "id": 1},
        {"points": [[0.03, 0.0, 0.05]], "normals": [[1.0, 0.0, 0.0]], "position_noise": 0.001},
        {"status": "missed", "free_points": [[0.1, 0.0, 0.05]], "free_radii": [0.01]},
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def _check_requests(path: Path) -> None:
    """Check that each line has an answer."""
    content, answers = path.read_bytes(), io.BytesIO()
    config, place = RunConfig(estimator="gpis"), ObjectPlace(size=0.1, support=0.0)
    with TemporaryDirectory() as folder:
        log = TouchLog(Path(folder) / "touches.jsonl", {})
        service = TouchService(
            Agent.of(config, 0.0, hand=Hand.load("wsg50")), place, Path(folder), log
        )
        answer_lines(service.answer, io.BytesIO(content), answers)
    written = [json.loads(line) for line in answers.getvalue().splitlines()]
    lines = content.split(b"\n")
    assert len(written) == len(lines) - (not lines[-1]) or any(b"stop" in line for line in lines)
    assert all(answer["ok"] or answer["error"] for answer in written)
    assert not any("failed: " in answer.get("error", "") for answer in written)


def _check_description(path: Path) -> None:
    """Read a hand as `hand new` does before it looks for pads."""
    efforts = dict.fromkeys(("knuckle", "spread", "bend", "slide"), 1.0)
    model = build_model(parse_description(path), path, DescriptionEdits(effort_limits=efforts))
    assert (model.lower <= model.upper).all()
    poses = link_kinematics(model).poses(np.eye(4), 0.5 * (model.lower + model.upper))
    assert np.isfinite(list(poses.values())).all()


def _write_arm(folder: Path, ending: str) -> Path:
    source = model_path("arms/iiwa14")
    shutil.copytree(source, folder, dirs_exist_ok=True)
    return next(folder.glob(f"*.{ending}"))


def _check_arm(path: Path) -> None:
    arm = Arm.load(next(path.parent.glob("*.yaml")))
    assert np.isfinite([arm.lower, arm.upper, arm.home]).all()
    assert np.isfinite(arm.kinematics.flange_poses(arm.home)).all()


def _check_pose(path: Path) -> None:
    X_WO = draw_pose(shapes.find("box"), str(path), (1e9, 1e9, 1e9))
    assert np.isfinite(X_WO).all()


def _check_obstacles(path: Path) -> None:
    mesh = load_obstacles(path)
    assert np.isfinite(mesh.vertices).all()


def _write_run(folder: Path, name: str) -> Path:
    """Write results of a run, without its simulations; return the file of a name."""
    facts = RunConfig("box", hand="wsg50", prober="kinematic").facts()
    header = provenance.describe(**facts)
    sphere_contacts(12, np.random.default_rng(1)).save(folder / "contacts.ply", header=header)
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    mesh.vertex_attributes["uncertainty"] = np.linspace(0.0, 0.01, len(mesh.vertices))
    save_surface(mesh, folder / "surface.ply", header=header)
    _save_grasps(folder / "grasps.json", header)
    _save_touches(folder / "touches.jsonl")
    search = {"found": True, "probes": 3, "seconds": 9.0}
    exploration = {"contacts": 12, "asked": 12, "probes": 14, "search": search, "motion": None}
    exploration |= {"covered_radius": 0.01, "reachable_coverage": 0.9, "estimate_coverage": 0.8}
    attempt = {"reason": "held", "success_probability": 0.9}
    lift = {"held": True, "lifted": True, "reason": "held", "mass": 0.2, "slip": 0.0, "turn": 0.0}
    planned = {"number": 2, "best_epsilon_estimate": 0.1, "best_epsilon_truth": 0.1}
    report = {"version": lis_grasp.__version__, "config": facts, "touches": 12, "lift": lift}
    report |= {"surface": {"rmsd": 1e-3, "edge_rmsd": None, "iou": 0.9}, "grasps": planned}
    report |= {"exploration": exploration, "attempts": [attempt]}
    (folder / "report.json").write_text(json.dumps(report))
    return folder / name


def _check_run(path: Path) -> None:
    """Read a folder of results as `Run.load` and `view` do."""
    run = Run.load(path.parent)
    assert run.lift is None or isinstance(run.lift, dict)
    with suppress(LisGraspError):
        assert run.task.facts()
    scene_of(path.parent).save(path.parent / "scene.html")


def _write_image(folder: Path, name: str) -> Path:
    """Write a small depth image, the YAML file of its camera, and their view; return one."""
    depth = np.full((12, 16), 500, dtype=np.uint16)
    Image.fromarray(depth).save(folder / "depth.png")
    facts = {"K": [[20.0, 0.0, 8.0], [0.0, 20.0, 6.0], [0.0, 0.0, 1.0]], "pose": np.eye(4).tolist()}
    (folder / "camera.yaml").write_text(yaml.safe_dump(facts))
    save_view(load_image(folder / "depth.png", folder / "camera.yaml"), folder / "view.npz")
    return folder / name


def _check_image(path: Path) -> None:
    view = load_image(path.with_name("depth.png"), path.with_name("camera.yaml"))
    assert not (view.depth < 0.0).any()


def _write_evaluation(folder: Path) -> Path:
    return Path(shutil.copy(SHIPPED / "quick.yaml", folder))


def _write_evaluation_rows(folder: Path) -> Path:
    job = next(Configuration.load(SHIPPED / "quick.yaml", ["surfaces"]).jobs(None))
    row = {"part": "surfaces", "job_seconds": 1.0, "version": lis_grasp.__version__, "commit": "0"}
    row |= SURFACES.facts(job.trial.trial) | {"estimator": "blend", "rmsd": 0.001}
    EvaluationResults(folder).lines.append([row])
    return folder / "rows.jsonl"


def _check_evaluation_rows(path: Path) -> None:
    rows = EvaluationResults(path.parent).read()
    configuration = Configuration.load(SHIPPED / "quick.yaml")
    sum(row["job_seconds"] for row in rows)
    configuration.ordered(rows)


READERS: dict[str, Reader] = {
    **{
        name: Reader(_saved(name, lambda path: _contacts().save(path)), _check_contacts)
        for name in ("contacts.ply", "contacts.csv")
    },
    **{
        f"mesh {ending}": Reader(_box(ending), lambda path: check_shape(shapes.load(path)))
        for ending in ("stl", "obj", "ply", "off", "glb", "gltf", "dae", "3mf")
    },
    "body dae": Reader(_box("dae"), lambda path: load_link_mesh(path, None)),
    "surface.ply": Reader(_surface, _check_surface),
    "grasps.json": Reader(_saved("grasps.json", _save_grasps), _check_grasps),
    "touches.jsonl": Reader(_saved("touches.jsonl", _save_touches), _check_touches),
    "motion.npz": Reader(_saved("motion.npz", _save_motion), _check_motion),
    "patches.npz": Reader(_saved("patches.npz", _save_patches), _check_patches),
    **{
        name: Reader(partial(_write_image, name=name), _check_image)
        for name in ("depth.png", "camera.yaml")
    },
    "view.npz": Reader(partial(_write_image, name="view.npz"), load_view),
    "requests": Reader(_saved("requests.jsonl", _save_requests), _check_requests),
    "study.yaml": Reader(_saved("study.yaml", _save_study), _check_study),
    "hand yaml": Reader(partial(_write_yaml, model="wsg50"), check_hand_file),
    "hand yaml of an sdf": Reader(partial(_write_yaml, model="claw"), check_hand_file),
    "hand urdf": Reader(partial(write_hand, model="wsg50"), check_hand_file),
    "hand urdf of three fingers": Reader(partial(write_hand, model="barrett"), check_hand_file),
    "hand sdf": Reader(partial(write_hand, model="claw"), check_hand_file),
    **{
        f"points {ending}": Reader(_saved(f"points.{ending}", _save_points), _check_points)
        for ending in ("csv", "off", "ply", "xyz", "pcd", "npy", "npz", "pts", "xyzn")
    },
    **{name: Reader(_saved(name, _save_points), _check_points) for name in _NAMED},
    "arm yaml": Reader(partial(_write_arm, ending="yaml"), _check_arm),
    "arm urdf": Reader(partial(_write_arm, ending="urdf"), _check_arm),
    "pose": Reader(_saved("pose.txt", lambda p: np.savetxt(p, np.eye(4))), _check_pose),
    "obstacles": Reader(_box("ply"), _check_obstacles),
    **{
        f"{name} of a run": Reader(partial(_write_run, name=name), _check_run)
        for name in ("report.json", "touches.jsonl", "contacts.ply", "surface.ply", "grasps.json")
    },
    "evaluation yaml": Reader(_write_evaluation, Configuration.load),
    "rows of an evaluation": Reader(_write_evaluation_rows, _check_evaluation_rows),
    **{
        f"log {ending}": Reader(_saved(f"log.{ending}", _save_log), _check_log)
        for ending in ("csv", "bag", "mcap", "db3")
    },
}
if importlib.util.find_spec("mujoco"):
    READERS["hand mjcf"] = Reader(
        _saved("hand.xml", lambda path: path.write_text(MJCF)), _check_description
    )
if importlib.util.find_spec("pyarrow"):
    READERS["rows.parquet"] = Reader(_saved("rows.parquet", _save_rows), _check_rows)
