"""Examples: each script runs from another folder and writes results that are checked here."""

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from lis_grasp import Contacts, Hand, load_contacts, load_world, shapes
from lis_grasp.motion import Motion
from lis_grasp.shapes.mesh_distance import distances_to_mesh

EXAMPLES = Path(__file__).parents[1] / "examples"


def _has_mesh(folder: Path) -> None:
    # As written: loading with processing would merge vertices that are equal in single precision.
    assert trimesh.load(folder / "surface.ply", process=False).is_watertight


def _has_grasps(folder: Path) -> None:
    grasps = json.loads((folder / "grasps.json").read_text(encoding="utf-8"))["grasps"]
    assert grasps
    assert all(grasp["quality"]["epsilon"] > 0.0 for grasp in grasps)


def _check_cube(folder: Path) -> None:
    assert len(Contacts.load(folder / "contacts.ply")) == 24
    _has_mesh(folder)
    # The contacts are exact and the planes through them bound the cube; noise only widens bands.
    assert trimesh.load(folder / "surface.ply").volume == pytest.approx(0.06**3, rel=1e-3)


def _check_hand(folder: Path) -> None:
    assert Hand.load(folder / "gripper.yaml").name == "gentle_gripper"
    _has_grasps(folder)


def _check_policy(folder: Path) -> None:
    assert len(Contacts.load(folder / "contacts.ply")) == 12
    _has_mesh(folder)


def _check_loop(folder: Path) -> None:
    contacts = Contacts.load(folder / "contacts.ply")
    assert len(contacts) == 20
    # Every answer of the robot is on its box of 12 cm.
    box = shapes.build("box", 0.12).mesh
    assert distances_to_mesh(contacts.points, box)[0].max() < 1e-9
    assert trimesh.load(folder / "surface.ply").volume == pytest.approx(box.volume, rel=0.1)


def _check_lift(folder: Path) -> None:
    assert len(Contacts.load(folder / "contacts.ply")) == 15
    _has_mesh(folder)
    _has_grasps(folder)
    height = Motion.load(folder / "motion.npz").poses["object"][:, 2, 3]
    assert height[-1] - height[0] > 0.05  # [m]: held to the end of the trial


def _check_comparison(folder: Path) -> None:
    with (folder / "errors.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4
    assert all(0.0 < float(row["rmsd_mm"]) < 100.0 for row in rows)


def _check_world(folder: Path) -> None:
    world = load_world(EXAMPLES / "own_world" / "bin.dmd.yaml", at="middle")
    assert [(body.name, body.is_fixed) for body in world] == [("bin", True), ("carton", False)]
    contacts = Contacts.load(folder / "contacts.ply")
    assert len(contacts) == 12
    # The object is in the bin, whose walls are 0.16 m from the middle; no contact is of a body.
    assert world.distances(contacts.points).min() > 0.02
    _has_mesh(folder)
    _has_grasps(folder)


CHECKS: dict[str, Callable[[Path], None]] = {
    "contacts_to_mesh": _check_cube,
    "mesh_to_grasps": _has_grasps,
    "own_hand": _check_hand,
    "own_estimator": _has_mesh,
    "own_policy": _check_policy,
    "robot_in_the_loop": _check_loop,
    "explore_to_lift": _check_lift,
    "own_diagram": _check_policy,
    "own_world": _check_world,
    "compare_estimators": _check_comparison,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHECKS)
def test_an_example_writes_its_results(name: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py", "--output", "out"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) >= 2
    CHECKS[name](tmp_path / "out")


def test_the_example_contacts_are_touches_of_the_mallet() -> None:
    contacts = load_contacts(EXAMPLES / "contacts.csv")
    assert len(contacts) == 40
    mallet = shapes.build("mallet")
    feet = contacts.points + [0, 0, mallet.mesh.bounds[0, 2]]  # it stands on z = 0
    four_deviations = 4 * 0.0005  # [m]
    assert distances_to_mesh(feet, mallet.mesh)[0].max() < four_deviations


def test_every_example_is_short_checked_and_listed() -> None:
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    scripts = sorted(EXAMPLES.glob("*.py"))
    assert {path.stem for path in scripts} == set(CHECKS)
    for path in scripts:
        assert len(path.read_text(encoding="utf-8").splitlines()) < 60
        assert f"[{path.name}]({path.name})" in listed
