"""What decides whether an exploration is resumed: its code, its files, its plug-ins."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from scenes import Told

from lis_grasp.cli.main import main
from lis_grasp.exploration import load_outcomes
from lis_grasp.io import provenance
from lis_grasp.pipeline import RunConfig, Scenario
from lis_grasp.results.exploring import explore_into
from lis_grasp.results.folder import Earlier

MODULE = "lis_grasp.stages.touch"
POLICY = """
from lis_grasp.exploration import Probe


class RoundRobin:
    def __init__(self, space):
        self.space = space

    def next_probe(self, contacts, surface, *, outcomes, rng):
        half = 0.5 * self.space.size
        side = [(1, 0), (-1, 0), (0, 1), (0, -1)][len(outcomes) % 4]
        target = self.space.center + [0.0, 0.0, 0.1 * half * (len(outcomes) % 7)]
        return Probe(target, direction=[*side, 0.0], standoff=3.0 * half, overshoot=half)
"""


def explored(folder: Path, *, fresh: bool = False, **options: object) -> list[str]:
    """Explore in a folder; return what was said."""
    config = RunConfig(**{"prober": "kinematic", "hand": "wsg50", "touches": 3, **options})
    progress = Told()
    earlier: Earlier = "fresh" if fresh else "resume"
    explore_into(folder, Scenario.from_config(config), progress=progress, earlier=earlier)
    return progress.lines


@pytest.fixture
def policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place])
    path = tmp_path / "mypol.py"
    path.write_text(POLICY, encoding="utf-8")
    yield path
    sys.modules.pop("mypol", None)


def _modules(*skipped: str) -> set[str]:
    return set(provenance._imported(MODULE, skipped))


def test_an_exploration_depends_on_the_code_that_it_runs_alone() -> None:
    modules = _modules("lis_grasp.grasping", "lis_grasp.simulation")
    for name in ("exploration.loop", "surfaces", "meshing", "probing.kinematic_prober"):
        assert f"lis_grasp.{name}" in modules
    rooms = {name.split(".")[1] for name in modules if "." in name}
    assert not rooms & {"cli", "visualization", "evaluation", "simulation", "logs"}
    assert "lis_grasp.grasping.sampler" not in modules
    assert "lis_grasp.results.report" not in modules
    assert "lis_grasp.simulation.drake.dynamic_prober" in _modules("lis_grasp.grasping")
    assert "lis_grasp.grasping.sampler" in _modules()  # for a rule that waits for a grasp


def test_an_edited_module_changes_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "lis_grasp"
    for name, text in (
        ("__init__", ""),
        ("work/__init__", ""),
        (
            "work/loop",
            "from lis_grasp.work import step\nfrom lis_grasp.other.part import (\n x,\n)",
        ),
        ("work/step", "from lis_grasp.work import loop  # a circle\n"),
        ("other/part", "x = 1\n"),
        ("other/figure", "colour = 'red'\n"),
    ):
        path = (package / name).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    monkeypatch.setattr(provenance, "_PACKAGE", package)
    monkeypatch.setattr(provenance, "_ROOT", package / "__init__.py")

    def digest(*skipped: str) -> str:
        provenance.source_digest.cache_clear()
        return provenance.source_digest("lis_grasp.work.loop", skipped)

    before, without = digest(), digest("lis_grasp.other")
    assert len(before) == 16
    (package / "other" / "figure.py").write_text("colour = 'blue'\n", encoding="utf-8")
    assert digest() == before
    (package / "other" / "part.py").write_text("x = 2\n", encoding="utf-8")
    assert digest() != before
    assert digest("lis_grasp.other") == without
    provenance.source_digest.cache_clear()


def test_a_finished_exploration_of_an_edited_policy_starts_from_the_beginning(
    policy: Path, tmp_path: Path
) -> None:
    results = tmp_path / "results"
    assert explored(results, policy="mypol:RoundRobin") == []
    (used,) = explored(results, policy="mypol:RoundRobin")
    assert used.startswith("using the")
    policy.write_text(POLICY + "# edited\n", encoding="utf-8")
    line, moved = explored(results, policy="mypol:RoundRobin")
    assert moved.startswith("moved contacts.ply")
    assert line == "starting from the beginning: mypol.py was edited"


def test_another_value_is_named_with_the_earlier_one(tmp_path: Path) -> None:
    explored(tmp_path)
    line, _ = explored(tmp_path, touches=2)
    assert line == "starting from the beginning: touches is 2, and was 3"


@pytest.mark.parametrize("estimator", ["gpis", "blend"])
def test_more_touches_go_on_as_if_they_had_been_asked_for_at_once(
    tmp_path: Path, estimator: str
) -> None:
    for touches in (3, 6):
        lines = explored(tmp_path / "later", touches=touches, estimator=estimator)
    assert len(lines) == 1
    assert lines[0].startswith("resuming after")
    explored(tmp_path / "once", touches=6, estimator=estimator)
    for name in ("touches.jsonl", "contacts.ply"):
        assert (tmp_path / "later" / name).read_bytes() == (tmp_path / "once" / name).read_bytes()


def test_a_fresh_exploration_is_asked_for(tmp_path: Path) -> None:
    explored(tmp_path)
    made = (tmp_path / "touches.jsonl").stat().st_mtime_ns
    line, _ = explored(tmp_path, fresh=True)
    assert line == "starting from the beginning, as asked"
    assert (tmp_path / "touches.jsonl").stat().st_mtime_ns > made
    assert explored(tmp_path / "new", fresh=True) == []


def test_the_option_fresh_explores_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["explore", "box", "--known", "--prober", "kinematic", "--hand", "wsg50"]
    arguments += ["--touches", "3", "--output", str(tmp_path)]
    assert main(arguments) == 0
    before = load_outcomes(tmp_path / "touches.jsonl")
    capsys.readouterr()
    assert main([*arguments, "--fresh"]) == 0
    assert "starting from the beginning, as asked" in capsys.readouterr().out
    assert len(load_outcomes(tmp_path / "touches.jsonl")) == len(before)


def test_an_exploration_starts_anew_if_a_model_of_its_world_changed(tmp_path: Path) -> None:
    model, world = tmp_path / "wall.sdf", tmp_path / "world.dmd.yaml"
    text = """<sdf version="1.7"><model name="wall"><static>true</static><link name="b">
    <pose>0 0.3 0.1 0 0 0</pose><collision name="c"><geometry><box><size>0.4 0.02 0.2</size></box>
    </geometry></collision></link></model></sdf>"""
    model.write_text(text, encoding="utf-8")
    world.write_text(
        f"directives:\n- add_model: {{name: wall, file: {model.as_uri()}}}\n", encoding="utf-8"
    )
    folder, options = tmp_path / "results", {"object": "box", "world": str(world)}
    explored(folder, **options)
    assert any(line.startswith("using the") for line in explored(folder, **options))
    model.write_text(text.replace("0 0.3 0.1", "0 0.35 0.1"), encoding="utf-8")
    again = explored(folder, **options)
    assert any(line.startswith("starting from the beginning") for line in again)
