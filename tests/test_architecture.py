"""The package's shape: which way imports point, where Drake is, what the public names are."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import lis_grasp

PACKAGE = Path(lis_grasp.__file__).resolve().parent

# The flow, one way: a module imports only from its own layer and from those above it in this list.
LAYERS = [
    ["exceptions"],
    [
        "bounding_volumes",
        "output_files",
        "ply_files",
        "json_lines",
        "model_files",
        "provenance",
        "read_only",
        "winding",
        "worker_pool",
    ],
    ["contacts", "contact_files", "shapes", "mesh_files", "motion"],
    ["surfaces"],
    ["exploration"],
    ["meshing"],
    ["grasping"],
    ["simulation"],
    ["evaluation"],
    ["run_config", "pipeline", "regrasp"],
    ["study"],
    ["visualization", "reporting", "scene_files"],
    ["paper_report", "study_report"],
    ["cli"],
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}


def _modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path != PACKAGE / "__init__.py"]


def _layer(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imports(path: Path, *, runtime_only: bool) -> list[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped: set[ast.AST] = set()
    if runtime_only:
        for node in ast.walk(tree):
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                skipped.update(ast.walk(node))
    names = []
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the direction of the flow"
            module = node.module or ""
            names += [f"{module}.{alias.name}" for alias in node.names]
    return names


@pytest.mark.parametrize("path", _modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_upstream(path: Path) -> None:
    own = _layer(path)
    assert own in LEVEL, f"'{own}' has no place in the flow yet: give it one in LAYERS"
    for name in _imports(path, runtime_only=True):
        parts = name.split(".")
        if parts[0] != "lis_grasp" or len(parts) < 2 or parts[1].startswith("__"):
            continue
        assert LEVEL[parts[1]] <= LEVEL[own], f"{own} must not import {name}: it is downstream"


@pytest.mark.parametrize("path", _modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_drake_is_imported_in_simulation_only(path: Path) -> None:
    if _layer(path) == "simulation":
        return
    drake = [n for n in _imports(path, runtime_only=False) if n.split(".")[0] == "pydrake"]
    assert not drake


def test_contacts_to_grasps_runs_where_drake_cannot_be_imported() -> None:
    program = """
import sys
sys.modules["pydrake"] = None
import numpy as np
import lis_grasp
for name in lis_grasp.__all__:
    getattr(lis_grasp, name)
from lis_grasp import ForceClosureSampler, Hand, LocalImplicitSurface, Contacts, extract_mesh
axes = np.vstack([np.eye(3), -np.eye(3)])
contacts = Contacts(points=0.03 * axes, normals=axes)
mesh = extract_mesh(LocalImplicitSurface.from_contacts(contacts))
search = ForceClosureSampler(Hand.load("wsg50")).sample(
    mesh, rng=np.random.default_rng(0), support_height=-0.03, count=1
)
assert search.candidates > 0
print(len(search.grasps))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 1


def test_every_public_name_resolves() -> None:
    for name in lis_grasp.__all__:
        assert getattr(lis_grasp, name) is not None


def test_unknown_public_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        lis_grasp.nonsense  # noqa: B018


def test_no_global_random_state() -> None:
    for path in _modules():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and ast.unparse(node).startswith("np.random."):
                assert node.attr in {"Generator", "default_rng", "SeedSequence"}, path
