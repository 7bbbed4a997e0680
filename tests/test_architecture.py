"""The package's structure: direction of imports, where Drake is, public names."""

import ast
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import networkx as nx
import pytest

import lis_grasp
import lis_grasp_studies
from lis_grasp import pipeline
from lis_grasp.stages import agent, lift, next_touch
from lis_grasp.stages.estimate import Perception
from lis_grasp.stages.plan import closure_probability, plan_grasps
from lis_grasp.stages.touch import make_perception, make_policy, make_strategy, stop_rules

PACKAGE = Path(lis_grasp.__file__).resolve().parent
STUDIES = Path(lis_grasp_studies.__file__).resolve().parent

# The flow: a module imports from its own folder and from those above it in this list, never below.
LAYERS = [
    ["_moved", "version", "exceptions", "guesses", "typing", "records", "geometry", "underflow"],
    ["io"],
    ["contacts", "motion", "plugins", "worker_pool"],
    ["shapes"],
    ["surfaces"],
    ["views"],
    ["meshing"],
    ["exploration"],
    ["robots"],
    ["world"],
    ["logs"],
    ["grasping"],
    ["arms"],
    ["probing"],
    ["lifting"],
    ["simulation"],
    ["evaluation"],
    ["visualization"],
    ["task"],
    ["stages"],
    ["results"],
    ["exports"],
    ["service"],
    ["pipeline"],
    ["testing"],
    ["drake"],
    ["cli"],
    ["lis_grasp", "_displays", "__main__"],
]
# What decides for the robot: it may know the true object by contacts only.
_ROBOT = ("exploration", "surfaces", "meshing", "grasping")
_OF_VERBS = ("add_arguments", "execute")
# The touch loop of any prober and the choice of an agent, and what starts them in `lis_grasp`.
_SHARED = {"explore", "next_touch"}
_TYPE_CHECKING = ast.dump(ast.Name("TYPE_CHECKING", ast.Load()))
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}


def _modules(package: Path = PACKAGE) -> list[Path]:
    return sorted(package.rglob("*.py"))


def _folder(module: str) -> str:
    return module.split(".")[1] if "." in module else "lis_grasp"


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def _imports(path: Path) -> list[str]:
    """Return every module that a file imports, inside functions and for types too.

    An `__init__.py` is a face: what it imports for types alone, it loads when a name is used.
    """
    nodes = _nodes(path)
    left_out = {
        child
        for node in nodes
        if path.name == "__init__.py"
        and isinstance(node, ast.If)
        and ast.dump(node.test) == _TYPE_CHECKING
        for child in ast.walk(node)
    }
    names = []
    for node in nodes:
        if isinstance(node, ast.Import) and node not in left_out:
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node not in left_out:
            assert node.level == 0, f"{path}: relative imports hide the direction of the flow"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def _module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _import_graph(package: Path = PACKAGE) -> nx.DiGraph:
    """Return modules of a package, with an arrow from each to every module that it imports."""
    modules = {_module_name(path): path for path in _modules(package)}
    graph = nx.DiGraph()
    graph.add_nodes_from(modules)
    for module, path in modules.items():
        for name in _imports(path):
            target = name if name in modules else name.rpartition(".")[0]
            if target in modules and target != module:
                graph.add_edge(module, target)
    return graph


def test_imports_follow_the_flow_without_circles() -> None:
    graph = _import_graph()
    unplaced = {_folder(module) for module in graph} - set(LEVEL)
    assert not unplaced, f"give each of {unplaced} a place in LAYERS"
    upward = [
        (module, target)
        for module, target in graph.edges
        if LEVEL[_folder(target)] > LEVEL[_folder(module)]
    ]
    assert not upward
    circles = [group for group in nx.strongly_connected_components(graph) if len(group) > 1]
    assert not circles


def test_a_module_depends_on_few_others() -> None:
    """Propagation cost: the mean fraction of modules that a module reaches (MacCormack 2006)."""
    graph = _import_graph()
    reached = sum(len(nx.descendants(graph, module)) for module in graph)
    assert reached / len(graph) ** 2 < 0.19


def test_a_public_name_has_one_meaning() -> None:
    """Top-level functions and classes; verbs of the command line have two functions each."""
    homes: dict[str, set[str]] = {}
    for path in _modules():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, set()).add(_module_name(path))
    several = {name: places for name, places in homes.items() if len(places) > 1}
    assert all(p.startswith("lis_grasp.cli.") for name in _OF_VERBS for p in several.pop(name))
    assert not several.keys() - _SHARED, several


@pytest.mark.parametrize(
    ("package", "folders"),
    [
        ("pydrake", {"lis_grasp.simulation.drake", "lis_grasp.drake"}),
        ("mujoco", {"lis_grasp.simulation.mujoco", "lis_grasp.robots"}),  # robots: reads MJCF
        ("coacd", {"lis_grasp.simulation.mujoco"}),
    ],
)
def test_a_simulator_is_imported_in_its_folder(package: str, folders: set[str]) -> None:
    using = {
        _module_name(path).rpartition(".")[0]
        for path in _modules()
        if any(name.split(".")[0] == package for name in _imports(path))
    }
    assert using == folders


def test_the_simulators_do_not_use_each_other() -> None:
    folders = {"lis_grasp.simulation.drake", "lis_grasp.simulation.mujoco"}
    pairs = {
        (module.rpartition(".")[0], target.rpartition(".")[0])
        for module, target in _import_graph().edges
    }
    assert not {(a, b) for a, b in pairs if {a, b} == folders}


@pytest.mark.parametrize("package", [PACKAGE, STUDIES])
def test_a_private_file_is_imported_in_its_own_folder_only(package: Path) -> None:
    for module, target in _import_graph(package).edges:
        folder, _, name = target.rpartition(".")
        if name.startswith("_"):
            assert module == folder or module.startswith(f"{folder}."), f"{module}: {target}"


def test_the_core_imports_no_studies() -> None:
    for path in _modules():
        assert not any(name.startswith("lis_grasp_studies") for name in _imports(path)), path


def test_imports_of_the_studies_have_no_circle_and_none_is_of_a_verb() -> None:
    graph = _import_graph(STUDIES)
    assert not [group for group in nx.strongly_connected_components(graph) if len(group) > 1]
    assert not [(a, b) for a, b in graph.edges if _folder(b) == "cli" != _folder(a)]


@pytest.mark.slow
def test_contacts_to_grasps_runs_where_drake_cannot_be_imported() -> None:
    program = """
import sys
sys.modules["pydrake"] = None
import numpy as np
import lis_grasp
from lis_grasp import pipeline
from lis_grasp.stages import agent, lift, next_touch, scenario, touch
for name in lis_grasp.__all__:
    getattr(lis_grasp, name)
from lis_grasp import ForceClosureSampler, Hand, LocalImplicitSurface, Contacts, extract_mesh
axes = np.vstack([np.eye(3), -np.eye(3)])
contacts = Contacts(points=0.03 * axes, normals=axes)
mesh = extract_mesh(LocalImplicitSurface.from_contacts(contacts))
search = ForceClosureSampler(Hand.load("wsg50"), candidates=20).sample(
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
    for package in (lis_grasp, pipeline):
        for name in package.__all__:
            assert getattr(package, name) is not None
        assert set(package.__all__) <= set(dir(package))


def test_notebooks_import_public_names_only() -> None:
    for path in sorted((PACKAGE.parent / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        text = "\n".join(sources).replace("%pip", "...  #")  # a command of IPython
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("lis_grasp"):
                public = import_module(str(node.module)).__all__
                assert {alias.name for alias in node.names} <= set(public), f"{path}: {node.module}"


def test_no_true_object_reaches_exploration_estimation_or_planning() -> None:
    truth = {"Shape", "find", "build", "load", "placed", "draw_pose"}
    for path in _modules():
        if path.relative_to(PACKAGE).parts[0] not in _ROBOT:
            continue
        for name in _imports(path):
            if name.startswith("lis_grasp.shapes."):
                assert name.rsplit(".", 1)[1] not in truth, f"{path} imports {name}"


def test_the_true_object_is_no_part_of_what_is_known() -> None:
    """What decides for the robot gets `Known`; of true things it has neither types nor names."""
    types = get_type_hints(agent.Agent)
    assert not {"shape", "truth", "config", "object", "mass", "friction"} & set(types)
    for text in map(str, types.values()):
        assert not any(name in text for name in ("Shape", "Truth", "Scenario", "RunConfig")), text


@pytest.mark.parametrize(
    "decision",
    [
        Perception,
        plan_grasps,
        closure_probability,
        make_perception,
        make_strategy,
        make_policy,
        stop_rules,
        lift.lift_options,
        next_touch.next_touch,
    ],
)
def test_no_decision_of_the_robot_is_given_the_true_object(decision: Callable[..., Any]) -> None:
    for parameter in inspect.signature(decision).parameters.values():
        for name in ("Shape", "Truth", "Scenario", "RunConfig"):
            assert name not in str(parameter.annotation), parameter


def test_a_function_of_the_pipeline_has_at_most_five_parameters() -> None:
    rooms = ("task", "stages", "results", "exports", "service", "pipeline")
    for path in (path for room in rooms for path in (PACKAGE / room).rglob("*.py")):
        for node in _nodes(path):
            if isinstance(node, ast.FunctionDef):
                arguments = node.args
                names = [a.arg for a in (*arguments.posonlyargs, *arguments.args)]
                names += [a.arg for a in arguments.kwonlyargs]
                given = [name for name in names if name not in ("self", "cls")]
                assert len(given) <= 5, f"{path.name}: {node.name} has {len(given)}"


def test_unknown_public_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        lis_grasp.nonsense  # noqa: B018


def test_no_global_random_state() -> None:
    for path in _modules():
        for node in _nodes(path):
            match node:
                case ast.Attribute(ast.Attribute(ast.Name("np"), "random"), attribute):
                    assert attribute in {"Generator", "default_rng", "SeedSequence", "get_state"}, (
                        path
                    )


def _indexed(node: ast.AST) -> tuple[str, str]:
    """Return what a subscript is of, and its last two indices; empty texts for other nodes."""
    if not isinstance(node, ast.Subscript):
        return "", ""
    indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    return ast.unparse(node.value), ", ".join(ast.unparse(index) for index in indices[-2:])


def _without_turns(node: ast.AST) -> ast.AST:
    """Return the array of an expression that transposes it, or that indexes a product of it."""
    match node:
        case ast.Attribute(array, "T") | ast.Call(ast.Attribute(array, "swapaxes" | "transpose")):
            if ast.unparse(array) != "np":
                return _without_turns(array)
    match node:
        case ast.Call(ast.Attribute(ast.Name("np"), "swapaxes" | "asarray"), [array, *_]):
            return _without_turns(array)
        case ast.Subscript(ast.BinOp() as product):
            return product
    return node


def _parts_of_poses(tree: ast.AST) -> dict[str, ast.AST]:
    """Return the values of the names that stand for a pose's rotation or translation."""
    pairs: list[tuple[ast.AST, ast.AST]] = []
    for node in ast.walk(tree):
        match node:
            case ast.Assign([ast.Tuple(names)], ast.Tuple(values)) if len(names) == len(values):
                pairs += zip(names, values, strict=True)
            case ast.Assign([name], value):
                pairs.append((name, value))
    return {
        name.id: value
        for name, value in pairs
        if isinstance(name, ast.Name) and _indexed(_without_turns(value))[1] in (":3, :3", ":3, 3")
    }


def _written_out(tree: ast.AST) -> list[str]:
    """Return the expressions that write out what `lis_grasp.geometry` has functions for.

    They are products of a pose with points, ``X[:3, :3] @ p + X[:3, 3]`` in any order or of its
    inverse, axes across a normal, and inverses of poses.
    """
    named = _parts_of_poses(tree)

    def part(node: ast.AST, indices: str) -> set[str]:
        node = _without_turns(node)
        if isinstance(node, ast.Name):
            node = _without_turns(named.get(node.id, node))
        pose, last = _indexed(node)
        return {pose} if last == indices else set()

    def turned_by(node: ast.AST) -> set[str]:
        match _without_turns(node):
            case ast.BinOp(left, ast.MatMult(), right):
                return part(left, ":3, :3") | part(right, ":3, :3")
        return set()

    def is_written_out(node: ast.AST) -> bool:
        match node:
            case ast.BinOp(left, ast.Add(), right):
                return bool(
                    turned_by(left) & part(right, ":3, 3") or turned_by(right) & part(left, ":3, 3")
                )
            case ast.BinOp(left, ast.MatMult(), ast.BinOp(_, ast.Sub(), p)):
                return bool(part(left, ":3, :3") & part(p, ":3, 3"))
            case ast.BinOp(ast.BinOp(_, ast.Sub(), p), ast.MatMult(), right):
                return bool(part(right, ":3, :3") & part(p, ":3, 3"))
            case ast.Subscript(ast.Call(ast.Attribute(ast.Name("np"), "eye")), index):
                return "argmin" in ast.unparse(index)
            case ast.Call(ast.Attribute(ast.Attribute(ast.Name("np"), "linalg"), "inv"), [matrix]):
                return bool(re.search(r"\bX(_\w+)?\b|pose|frame|link", ast.unparse(matrix)))
        return False

    return [ast.unparse(node) for node in ast.walk(tree) if is_written_out(node)]


@pytest.mark.parametrize(
    "code",
    [
        "a = X[:3, :3] @ p + X[:3, 3]",
        "a = p @ links[k][:3, :3].T + links[k][:3, 3]",
        "a = p @ np.swapaxes(X[:, :3, :3], 1, 2) + X[:, None, :3, 3]",
        "a = p @ X[:, :3, :3].transpose(0, 2, 1) + X[:, None, :3, 3]",
        "a = (X[..., :3, :3] @ p[..., None])[..., 0] + X[..., :3, 3]",
        "a = X[:, :3, 3] + X[:, :3, :3] @ np.asarray(p)",
        "R, t = self.X_OH[:3, :3], self.X_OH[:3, 3]\na = p @ R.T + t",
        "R = X[:3, :3].T\na = R @ (p - X[:3, 3])",
        "a = (p - X[:3, 3]) @ X[:3, :3]",
        "a = np.eye(3)[np.argmin(np.abs(n), axis=-1)]",
        "a = np.linalg.inv(self.X_WA @ X)",
        "a = np.linalg.inv(poses[0])",
    ],
)
def test_geometry_that_is_written_out_is_seen(code: str) -> None:
    assert len(_written_out(ast.parse(code))) == 1


@pytest.mark.parametrize(
    "code",
    [
        "a = X[:3, :3] @ p + Y[:3, 3]",
        "a = X[:3, :3] @ Y[:3, :3].T",
        "a = p + X[:3, 3]",
        "a = np.eye(3)[0]",
        "a = np.linalg.inv(columns.T @ columns)",
    ],
)
def test_other_products_are_not_taken_for_geometry(code: str) -> None:
    assert not _written_out(ast.parse(code))


def test_poses_and_tangents_are_computed_in_one_file() -> None:
    root = PACKAGE.parent
    for folder in (PACKAGE, root / "lis_grasp_studies", root / "benchmarks"):
        for path in sorted(folder.rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if path != PACKAGE / "geometry.py" and re.search(r":3|linalg\.inv|argmin", text):
                written = _written_out(ast.parse(text))
                assert not written, f"{path}: use lis_grasp.geometry for {written}"
