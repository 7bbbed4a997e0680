"""Plug-ins by entry point and by module: the example package as if installed."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lis_grasp as lg
from lis_grasp import Contacts, Hand, pipeline, shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import (
    InvalidContactsError,
    InvalidHandError,
    InvalidOptionError,
    PluginError,
)
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.io.surface_files import load_surface
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.surfaces import ESTIMATORS
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES, find_estimator
from lis_grasp_studies.estimators import TUNED, compared_estimator
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.trial import Setup, Trial, row_key

tomllib = pytest.importorskip("tomllib")

AXIAL = Contacts(0.03 * np.vstack([np.eye(3), -np.eye(3)]), np.vstack([np.eye(3), -np.eye(3)]))
EXAMPLE = Path(__file__).parents[1] / "examples" / "own_package"
OWN = """
class Flat:
    def __init__(self, contacts):
        self.bounds = contacts.bounds

    def evaluate(self, points):
        return points[..., 2]

    def gradient(self, points):
        return 0.0 * points + [0.0, 0.0, 1.0]

    def uncertainty(self, points):
        return 0.001 + 0.0 * points[..., 0]


class Flatter(Flat):
    gradient = Flat.evaluate


class Failing:
    def __init__(self, contacts):
        raise IndexError("no such row")


def number(contacts):
    return 3


constant = 3
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder on the search path in which the example package is installed."""
    site = tmp_path / "site"
    shutil.copytree(EXAMPLE / "lis_grasp_example", site / "lis_grasp_example")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = site / "lis_grasp_example-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(site))
    yield site
    for name in [name for name in sys.modules if name.startswith("lis_grasp_example")]:
        del sys.modules[name]


@pytest.fixture
def own_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a module in the current folder, which is not on the search path."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    (tmp_path / "own_surfaces.py").write_text(OWN, encoding="utf-8")
    yield tmp_path / "own_surfaces.py"
    sys.modules.pop("own_surfaces", None)


@pytest.fixture
def contacts(installed: Path) -> Contacts:
    """Contacts by the policy of the example package with its hand and estimator."""
    config = pipeline.RunConfig(
        hand="square_jaw",
        policy="from_above",
        estimator="nearest_plane",
        prober="kinematic",
        touches=6,
    )
    hand = Hand.load(config.hand)
    assert hand.name == "square_jaw"
    assert all(finding.fine for finding in hand_findings(hand))
    scenario = pipeline.Scenario.from_config(config, shapes.build("box", 0.06))
    return pipeline.touch(scenario).contacts


def test_an_installed_package_is_found_in_every_role(contacts: Contacts) -> None:
    assert "nearest_plane" in ESTIMATOR_NAMES.names
    assert "from_above" in POLICY_NAMES.names
    assert (contacts.normals[:, 2] > 0.99).sum() >= 5  # the policy touches the top
    for find in (find_estimator, compared_estimator, partial(compared_estimator, registry=TUNED)):
        assert callable(find("nearest_plane"))
    surface, _ = pipeline.estimate(pipeline.Perception(estimator="nearest_plane"), contacts)
    assert abs(surface.evaluate(contacts.points)).max() < 1e-12


def test_a_package_cannot_take_the_names_of_this_one(installed: Path) -> None:
    points = installed / "lis_grasp_example-0.1.dist-info" / "entry_points.txt"
    points.write_text("[lis_grasp.estimators]\nblend = lis_grasp_example:square_jaw")
    assert find_estimator("blend") is ESTIMATORS["blend"]
    assert ESTIMATOR_NAMES.names.count("blend") == 1


def test_a_class_in_the_current_folder_is_an_estimator_of_every_verb(
    own_module: Path, tmp_path: Path
) -> None:
    find_estimator("own_surfaces:Flat")
    study = Study(estimators=("gpis", "own_surfaces:Flat"), explorer="own_surfaces:Flat")
    assert study.estimators[1] == "own_surfaces:Flat"
    axes = np.vstack([np.eye(3), -np.eye(3)])
    Contacts(0.03 * axes, axes).save(tmp_path / "contacts.ply")
    arguments = ["estimate", str(tmp_path / "contacts.ply"), "--estimator"]
    assert main([*arguments, "own_surfaces:Flat"]) == 0
    # The lower half of the box of the contacts.
    assert load_surface(tmp_path / "surface.ply").volume == pytest.approx(0.5 * 0.06**3, rel=0.1)
    assert main([*arguments, "own_surfaces:Absent"]) == 2


@pytest.mark.parametrize(
    ("name", "error", "text"),
    [
        (
            "own_surfaces:Failing",
            PluginError,
            "raised IndexError at own_surfaces.py:22: no",
        ),
        ("own_surfaces:Flatter", InvalidOptionError, r"gradient must return shape \(2, 3\)"),
        ("own_surfaces:number", InvalidOptionError, "int has no evaluate"),
        ("own_surfaces:constant", InvalidOptionError, "a class with from_contacts"),
        ("own_surfaces:absent", InvalidOptionError, "no attribute 'absent'"),
        ("absent_module:Class", InvalidOptionError, "No module named 'absent_module'"),
        ("blnd", InvalidOptionError, "did you mean 'blend'"),
    ],
)
def test_a_mistake_is_one_sentence(
    name: str, error: type[Exception], text: str, own_module: Path
) -> None:
    axes = [[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]
    with pytest.raises(error, match=text):
        find_estimator(name)(Contacts(axes, axes))


def test_a_mistyped_policy_or_hand_names_the_nearest() -> None:
    with pytest.raises(InvalidOptionError, match="'frontier'"):
        pipeline.RunConfig(policy="fronteer")
    with pytest.raises(InvalidHandError, match="'allegro'"):
        Hand.load("alegro")


def test_an_edited_plug_in_is_another_row(own_module: Path) -> None:
    trial = Trial("box", "allegro", 10, "none", 0, Setup())
    before, ours = row_key(trial, "own_surfaces:Flat"), row_key(trial, "blend")
    own_module.write_text(OWN + "# edited\n", encoding="utf-8")
    assert row_key(trial, "own_surfaces:Flat") != before
    assert row_key(trial, "blend") == ours


def test_a_file_s_name_is_answered_by_the_module_s(own_module: Path) -> None:
    for registry in (ESTIMATOR_NAMES, POLICY_NAMES):
        with pytest.raises(InvalidOptionError, match=r": write own_surfaces:Flat$"):
            registry.find("own_surfaces.py:Flat")


def two(points: Any, normals: Any) -> None: ...
def keyword(contacts: Any, *, scale: float) -> None: ...
def nothing() -> None: ...


class Empty: ...


@pytest.mark.parametrize("make", [two, keyword, nothing, Empty])
def test_what_takes_other_arguments_is_refused_as_a_task_is_made(make: Any) -> None:
    taken = {two: "it takes points, normals", nothing: "it takes nothing"}.get(make, "it takes")
    calls: list[Any] = [
        lambda: lg.Task.of("box", estimator=make),
        lambda: lg.estimate(AXIAL, make),
        lambda: lg.Task.of("box", policy=make),
    ]
    for call in calls:
        with pytest.raises(InvalidOptionError, match=taken):
            call()


def one(contacts: Any) -> None: ...
def noisy(contacts: Any, position_noise: float, *, normal_noise: float) -> None: ...
def usual(contacts: Any, scale: float = 1.0) -> None: ...
def any_number(*contacts: Any, **options: Any) -> None: ...


@pytest.mark.parametrize("make", [one, noisy, usual, any_number, partial(two, normals=0)])
def test_what_can_be_called_with_contacts_and_noise_is_an_estimator(make: Any) -> None:
    assert lg.Task.of("box", estimator=make).decide.estimator is make
    if make is not noisy:
        assert lg.Task.of("box", policy=make).decide.policy is make


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_the_class_of_an_estimator_is_the_estimator(name: str) -> None:
    kind = ESTIMATORS[name].__self__  # type: ignore[attr-defined]
    points = AXIAL.points + 0.004
    np.testing.assert_array_equal(
        lg.estimate(AXIAL, kind).evaluate(points), lg.estimate(AXIAL, name).evaluate(points)
    )


POLICY = """
class RoundRobin:
    def __init__(self, space):
        self.space = space

    def next_probe(self, contacts, surface, *, outcomes, rng):
        return contacts.bounds.mean(axis=0)


class Typo(RoundRobin):
    def next_probe(self, contacts, surface, *, outcomes, rng):
        return len(3)


class NoProbe(RoundRobin):
    def next_probe(self, contacts, surface, *, outcomes, rng):
        return "a probe"


class Early(RoundRobin):
    def __init__(self, space):
        raise ValueError("too early")


class Wavy:
    bounds = [[0.0] * 3, [0.1] * 3]

    def __init__(self, contacts):
        self.calls = 0

    def evaluate(self, points):
        self.calls += 1
        if self.calls > 2:  # after the checks of shapes and signs
            raise ValueError("too wavy")
        return points[..., 2]

    gradient = staticmethod(lambda points: 0.0 * points)
    uncertainty = staticmethod(lambda points: points[..., 0])
"""


@pytest.fixture
def own_policies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    (tmp_path / "mypol.py").write_text(POLICY, encoding="utf-8")
    yield
    sys.modules.pop("mypol", None)


@pytest.mark.by_default("Typo-mypol.py:12-TypeError")
@pytest.mark.usefixtures("own_policies")
@pytest.mark.parametrize(
    ("name", "place", "cause"),
    [
        ("RoundRobin", "mypol.py:7", InvalidContactsError),
        ("Typo", "mypol.py:12", TypeError),
        ("Early", "mypol.py:22", ValueError),
    ],
)
def test_an_error_of_a_policy_names_its_place(
    name: str, place: str, cause: type[Exception]
) -> None:
    config = pipeline.RunConfig(prober="kinematic", policy=f"mypol:{name}", touches=2)
    with pytest.raises(PluginError, match=place) as error:
        pipeline.touch(pipeline.Scenario.from_config(config))
    assert isinstance(error.value.__cause__, cause)
    assert error.value.plugin == f"mypol:{name}"


@pytest.mark.usefixtures("own_policies")
def test_a_policy_returns_a_probe_and_a_surface_that_fails_later_is_named() -> None:
    config = pipeline.RunConfig(prober="kinematic", policy="mypol:NoProbe", touches=2)
    with pytest.raises(InvalidOptionError) as error:
        pipeline.touch(pipeline.Scenario.from_config(config))
    assert error.value.value == "mypol:NoProbe"
    axes = np.vstack([np.eye(3), -np.eye(3)])
    surface = find_estimator("mypol:Wavy")(Contacts(0.03 * axes, axes))
    with pytest.raises(PluginError) as error:
        surface.evaluate(axes)
    assert error.value.plugin == "mypol:Wavy"
    assert isinstance(error.value.__cause__, ValueError)


def test_an_error_of_a_hand_names_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "myhand.py").write_text("def jaw():\n    raise OSError('no file')\n")
    (tmp_path / "myhand-0.1.dist-info").mkdir()
    info = tmp_path / "myhand-0.1.dist-info"
    (info / "METADATA").write_text("Name: myhand\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text("[lis_grasp.hands]\nmy_jaw = myhand:jaw\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PluginError, match="myhand.py:2"):
        Hand.load("my_jaw")
    sys.modules.pop("myhand")
