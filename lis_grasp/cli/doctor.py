"""`lis-grasp doctor`: checks of this machine, or of the files of a hand or an arm."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lis_grasp.arms.check import check_arm
from lis_grasp.cli.progress import say, say_findings
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, LisGraspError
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import Finding, hand_findings
from lis_grasp.robots.repair_file import write_repaired
from lis_grasp.robots.yaml_files import description_of
from lis_grasp.stages.estimate import SurfaceEstimate
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import touch
from lis_grasp.task.task import Task
from lis_grasp.version import __version__

_PACKAGES = ("drake", "numpy", "scipy", "trimesh", "python-fcl", "meshcat", "manifold3d")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
_ENOUGH_MEMORY = 2.0  # [GiB]
# Renders an empty depth image with Drake.
_RENDERING = """
from pydrake.geometry import ClippingRange, DepthRange, DepthRenderCamera, MakeRenderEngineVtk
from pydrake.geometry import RenderCameraCore, RenderEngineVtkParams
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo, ImageDepth32F
core = RenderCameraCore("", CameraInfo(8, 8, 1.0), ClippingRange(0.1, 1.0), RigidTransform())
camera, image = DepthRenderCamera(core, DepthRange(0.1, 1.0)), ImageDepth32F(8, 8)
MakeRenderEngineVtk(RenderEngineVtkParams()).RenderDepthImage(camera, image)
assert (image.data == float("inf")).all()
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument("--hand", metavar="HAND", help="check this hand: a name or a YAML file")
    parser.add_argument(
        "--arm",
        metavar="ARM",
        help="check this arm with the hand (default: allegro): a name or a YAML file",
    )
    parser.add_argument(
        "--repair",
        type=Path,
        metavar="OUT",
        help="write a copy of the hand's URDF or SDF with impossible inertias and missing masses"
        " replaced",
    )
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Print what is fine and what to fix; LisGraspError if something must be fixed."""
    if options.repair is not None:
        _repair(options.hand, options.repair)
        return
    if options.arm is not None:
        hand = Hand.load(options.hand or Task().robot.hand)
        findings = check_arm(Arm.load(options.arm), hand)
    elif options.hand is not None:
        findings = hand_findings(Hand.load(options.hand))
    else:
        findings = check_machine()
    say_findings(findings)
    faults = sum(not finding.fine for finding in findings)
    if faults:
        raise LisGraspError(f"{faults} of {len(findings)} findings must be fixed, see above")


def _repair(hand: str | None, output: Path) -> None:
    """Write a corrected copy of a hand's description, and print what changed."""
    if hand is None:
        raise InvalidOptionError("--repair needs the hand: name it with --hand", option="repair")
    description, edits = description_of(hand)
    if output.exists():
        raise InvalidFileError(f"{output} exists: name another file", path=output)
    changes = write_repaired(description, edits, output)
    for change in changes:
        say(f"repaired: {change}")
    say(f"wrote {output}: {len(changes)} links changed; name it under urdf in the hand's YAML")


def check_machine() -> list[Finding]:
    """Return the findings on versions, Drake, memory, browser, and a short run up to grasps."""
    machine = (
        f"lis-grasp {__version__}, Python {platform.python_version()},"
        f" {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    checks = _packages(), _drake(), _rendering(), _memory(), _browser(), _self_test()
    return [Finding(True, machine), *checks]


def _packages() -> Finding:
    versions, missing = [], []
    for package in _PACKAGES:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            missing.append(package)
    if missing:
        return Finding(False, f"not installed: {', '.join(missing)}; install lis-grasp with pip")
    return Finding(True, ", ".join(versions))


def _drake() -> Finding:
    # In a separate process, because a missing library can end the process.
    command = [sys.executable, "-c", "import pydrake.multibody.plant"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return Finding(True, "Drake can be imported")
    reason = (done.stderr.strip().splitlines() or ["it ended without a message"])[-1]
    advice = "; install Debian's libglib2.0-0" if "libgthread" in reason or "glib" in reason else ""
    return Finding(False, f"Drake cannot be imported: {reason}{advice}")


def _rendering() -> Finding:
    """Return whether Drake's renderer works: for cameras in Diagrams only, so no fault if not."""
    # Without a driver of EGL it ends the process.
    command = [sys.executable, "-c", _RENDERING]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return Finding(True, "Drake can render depth images")
    crash = f"it crashed with signal {-done.returncode}"
    reason = (
        crash if done.returncode < 0 else (done.stderr.strip().splitlines() or ["no reason"])[-1]
    )
    return Finding(
        True,
        f"Drake cannot render depth images ({reason}): an RgbdSensor needs EGL, Debian's libegl1"
        " and libgl1-mesa-dri; run --camera does not",
    )


def _memory() -> Finding:
    # Free pages alone would leave out what the system's caches give back on demand.
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        kibibytes = next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return Finding(True, "memory: unknown on this system")
    available = kibibytes / 2**20
    enough = available >= _ENOUGH_MEMORY
    advice = "" if enough else f"; a process needs up to {_ENOUGH_MEMORY:g} GiB"
    return Finding(enough, f"available memory: {available:.1f} GiB{advice}")


def _browser() -> Finding:
    browser = next((name for name in _BROWSERS if shutil.which(name)), None)
    absent = "none found; open it on another machine, it is one file"
    return Finding(True, f"browser for scene.html: {browser or absent}")


def _self_test() -> Finding:
    """Touch a box by geometry, estimate it, and plan grasps; takes seconds."""
    start = time.perf_counter()
    task = Task.of(known=True, prober="kinematic", touches=15, grasps=2)
    try:
        scenario = Scenario.from_config(task)
        touched = touch(scenario)
        mesh = SurfaceEstimate(touched.contacts, scenario.agent.perception).mesh
        search = plan_grasps(scenario.agent, mesh)
    except LisGraspError as error:
        return Finding(False, f"the self-test failed: {error}")
    counts = f"{touched.made} touches of a box, {len(search.grasps)} grasps"
    seconds = time.perf_counter() - start
    return Finding(bool(search.grasps), f"self-test: {counts} in {seconds:.1f} s")
