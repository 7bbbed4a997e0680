"""Fuzzing cases of damaged URDF, SDF and YAML: `Hand.load` and the checks of `doctor`."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
import yaml

from fuzzing.cases import Case, Kind, require
from fuzzing.claw import SDF, YAML
from fuzzing.mutations import damage_bytes, damage_plain, damage_xml
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import check_hand
from lis_grasp.robots.shipped_models import model_path

Generator = np.random.Generator

# One body is a mesh, so that its file can be damaged too.
_SDF = SDF.replace("<pose>0.01 0 0 0 0 0.3</pose>", "").replace(
    "<box><size>0.06 0.05 0.04</size></box>",
    "<mesh><uri>body.stl</uri><scale>1 1 1</scale></mesh>",
)


def write_hand(folder: Path, group: str, rng: Generator) -> tuple[Path, Path]:
    """Write a valid hand with a mesh file; return its YAML and its URDF or SDF."""
    folder.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box(extents=(0.06, 0.05, 0.04)).export(folder / "body.stl")
    if group == "sdf" or (group == "yaml" and rng.random() < 0.3):
        (folder / "claw.sdf").write_text(_SDF)
        (folder / "claw.yaml").write_text(yaml.safe_dump(YAML))
        return folder / "claw.yaml", folder / "claw.sdf"
    name = str(rng.choice(["wsg50", "wsg50", "barrett"]))
    for ending in (".yaml", ".urdf"):
        shutil.copy(model_path(f"hands/{name}/{name}{ending}"), folder)
    urdf = folder / f"{name}.urdf"
    box = '<box size="0.146 0.0495 0.0725"/>'
    urdf.write_text(urdf.read_text().replace(box, '<mesh filename="body.stl" scale="1 1 1"/>'))
    return folder / f"{name}.yaml", urdf


def make(group: str, index: int, rng: Generator, folder: Path) -> Case:
    """Return a hand, one of whose files is damaged."""
    hand, model = write_hand(folder / "hand", group, rng)
    file = hand if group == "yaml" else model
    ways = [str(way) for way in _SPECIAL if group in _SPECIAL[way][0]]
    if rng.random() < 0.02:
        fault, sound = "nothing wrong", True
    elif rng.random() < 0.25:
        fault, sound = str(rng.choice(ways)), False
        _SPECIAL[fault][1](file)
    elif rng.random() < 0.15:
        content, fault = damage_bytes(rng, file.read_bytes())
        sound = False
        file.write_bytes(content)
    elif group == "yaml":
        plain, fault = damage_plain(rng, yaml.safe_load(file.read_text()))
        sound = False
        file.write_text(yaml.safe_dump(plain, allow_unicode=True))
    else:
        text, fault = damage_xml(rng, file.read_text())
        sound = False
        file.write_text(text)
    return Case(f"{file.name} with {fault}", lambda: check_loaded(hand), sound)


def check_loaded(path: Path) -> None:
    """Require a hand with limits in order, finite kinematics, and findings that are sentences."""
    hand = Hand.load(path)
    require(bool((hand.lower < hand.upper).all()), "limits are in order")
    require(bool(np.isfinite([hand.lower, hand.upper]).all()), "limits are finite")
    require(bool((hand.effort_limits > 0.0).all()), "efforts are above 0")
    middle = 0.5 * (hand.lower + hand.upper)
    require(bool(np.isfinite(hand.pad_centers(np.eye(4), middle)).all()), "kinematics is finite")
    require(bool(np.isfinite(hand.pad_jacobians(np.eye(4), middle)[2]).all()), "Jacobian is finite")
    poses = hand.forward_kinematics(np.eye(4), middle).values()
    turns = np.array([pose[:3, :3] for pose in poses])
    rigid = np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max() < 1e-6
    require(bool(rigid), "links' poses are rigid")
    masses = [inertial.mass for inertial in hand.inertials.values()]
    require(bool(np.isfinite(masses).all() and min(masses) >= 0.0), "masses are finite")
    tensors = np.array([inertial.inertia_L for inertial in hand.inertials.values()])
    require(bool(np.isfinite(tensors).all()), "inertias are finite")
    for geometry in hand.link_geometries:
        require(bool(np.isfinite(geometry.mesh.vertices).all()), "bodies are finite")
        require(all(size > 0.0 for size in geometry.dimensions), "bodies have positive sizes")
    findings = check_hand(hand)
    require(all(f.text.strip() for f in findings), "findings have texts")


def _write(content: str) -> Callable[[Path], None]:
    return lambda file: file.write_text(content, encoding="utf-8") and None


def _replace(old: str, new: str) -> Callable[[Path], None]:
    def act(file: Path) -> None:
        text = file.read_text()
        file.write_text(text.replace(old, new, 1))

    return act


def _entities(depth: int) -> str:
    """Return XML that grows tenfold with every level of its entities."""
    levels = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10 if i else "ha"}">' for i in range(depth))
    return f'<?xml version="1.0"?><!DOCTYPE r [{levels}]><robot name="&e{depth - 1};"/>'


_LONG_ENTITY = (
    f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e "{"ha" * 40_000}">]>'
    f'<robot name="r"><link name="{"&e;" * 80_000}"/></robot>'
)
_FILE_ENTITY = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    '<robot name="r"><link name="a">&e;</link></robot>'
)
# Nested aliases: a few hundred bytes that expand to 9^11 words.
_ALIASES = ", ".join(
    ["&a0 [x, x, x, x, x, x, x, x, x]"]
    + [f"&a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
)


def _without_meshes(file: Path) -> None:
    (file.parent / "body.stl").unlink()


def _empty_mesh(file: Path) -> None:
    (file.parent / "body.stl").write_bytes(b"")


def _torn_mesh(file: Path) -> None:
    mesh = file.parent / "body.stl"
    mesh.write_bytes(mesh.read_bytes()[:200])


def _without_model(file: Path) -> None:
    for model in [*file.parent.glob("*.urdf"), *file.parent.glob("*.sdf")]:
        model.unlink()


def _aliased(key: str) -> Callable[[Path], None]:
    """Give a key of the YAML a value that expands to an enormous list."""

    def act(file: Path) -> None:
        content = yaml.safe_load(file.read_text())
        content.pop(key)
        file.write_text(yaml.safe_dump(content) + f"{key}: [{_ALIASES}]\n")

    return act


_XML, _BOTH, _TEXT = ("urdf", "sdf"), ("urdf", "sdf", "yaml"), ("yaml",)
_SPECIAL: dict[str, tuple[tuple[str, ...], Callable[[Path], None]]] = {
    "no file of its mesh": (_BOTH, _without_meshes),
    "an empty file as its mesh": (_BOTH, _empty_mesh),
    "a torn mesh": (_BOTH, _torn_mesh),
    "a mesh outside of its folder": (_XML, _replace("body.stl", "../../../../../../etc/passwd")),
    "a mesh at the root": (_XML, _replace("body.stl", "file:///etc/passwd")),
    "a mesh that is a device": (_XML, _replace("body.stl", "/dev/zero")),
    "a mesh that is its folder": (_XML, _replace("body.stl", ".")),
    "a mesh from the net": (_XML, _replace("body.stl", "https://localhost:1/body.stl")),
    "a mesh of a package above": (_XML, _replace("body.stl", "package://../../etc/passwd")),
    "a mesh whose name has a zero byte": (_XML, _replace("body.stl", "a%00.stl")),
    "a mesh with a very long name": (_XML, _replace("body.stl", "a" * 5000)),
    "a mesh turned inside out": (_XML, _replace("1 1 1", "-1 1 1")),
    "a mesh without size": (_XML, _replace("1 1 1", "0 0 0")),
    "an entity bomb": (_XML, _write(_entities(12))),
    "a small entity bomb": (_XML, _write(_entities(5))),
    "one long entity": (_XML, _write(_LONG_ENTITY)),
    "an entity of a file": (_XML, _write(_FILE_ENTITY)),
    "no actuators": (_XML, _replace('type="', 'type="fixed" was="')),
    "nothing in it": (_BOTH, _write("")),
    "another root": (_XML, _write("<html><body/></html>")),
    "a robot without anything": (_XML, _write('<robot name="r"/>')),
    "a deep tree": (_XML, _write("<robot name='r'>" + "<a>" * 100_000)),
    "no URDF": (_TEXT, _without_model),
    "aliases that multiply, at the top": (_TEXT, _write(f"[{_ALIASES}]")),
    "aliases that multiply, as joints": (_TEXT, _aliased("joints")),
    "aliases that multiply, as name": (_TEXT, _aliased("name")),
    "aliases that multiply, as pads": (_TEXT, _aliased("pads")),
    "aliases that multiply, as approach": (_TEXT, _aliased("approach")),
    "itself in itself": (_TEXT, _write("&a {name: *a, kind: *a, pads: [*a]}")),
    "a tag of Python": (_TEXT, _write("!!python/object/apply:os.system ['true']")),
    "a list at the top": (_TEXT, _write("- a\n- b\n")),
    "a URDF outside": (_TEXT, _replace("urdf: ", "urdf: ../../../../../../etc/passwd #")),
}

KIND = Kind(("urdf", "sdf", "yaml"), make)
