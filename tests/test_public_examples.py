"""Every public name explains itself by an example, and the examples run as shown."""

import doctest
import re
from pathlib import Path

import numpy as np
import pydrake.all
import pytest

import lis_grasp
from lis_grasp import Contacts, drake, pipeline, testing
from lis_grasp.exploration import Workspace

_OF_DRAKE = ("AddMultibodyPlantSceneGraph", "CameraInfo", "DiagramBuilder", "RigidTransform")
_VALUES = ("__version__", "pipeline.SILENT")  # have no docstring of their own
_NAMES = [*lis_grasp.__all__, *(f"pipeline.{name}" for name in pipeline.__all__)]
_NAMES += [f"drake.{name}" for name in drake.__all__]
_NAMES += [f"testing.{name}" for name in testing.__all__]
# Examples that simulate a lift, or plan and watch as others do.
_SLOW = {"run", "Run", "lift", "pipeline.lift_each", "pipeline.lift_file"}
_SLOW |= {"pipeline.run", "pipeline.Run", "pipeline.lift", "pipeline.label_file"}
_SLOW |= {"Grasp", "GraspSearch", "pipeline.plan", "pipeline.grasp_file", "pipeline.Watched"}
_SLOW |= {"testing.check_estimator", "testing.check_policy", "testing.check_hand"}


def _marked(name: str) -> object:
    return pytest.param(name, marks=pytest.mark.slow if name in _SLOW else ())


# Packages of extras.
_NEEDED = {"pipeline.Bars": "tqdm", "pipeline.label_file": "pyarrow"}


@pytest.mark.parametrize("name", [_marked(name) for name in _NAMES if name not in _VALUES])
def test_the_example_of_a_public_name_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name in _NEEDED:
        pytest.importorskip(_NEEDED[name])
    monkeypatch.chdir(tmp_path)
    public = {name: getattr(lis_grasp, name) for name in lis_grasp.__all__}
    axes = np.vstack([np.eye(3), -np.eye(3)])
    if name.startswith("drake."):
        public |= {"drake": drake, "Workspace": Workspace, **vars(drake)}
        public |= {of: getattr(pydrake.all, of) for of in _OF_DRAKE}
    if name.startswith("testing."):
        public |= {"testing": testing, **{of: getattr(testing, of) for of in testing.__all__}}
    space = public | {"np": np, "Path": Path, "contacts": Contacts(0.03 * axes, axes)}
    value = eval(name, space)  # noqa: S307
    text = value.__doc__
    assert text, name
    assert ">>>" in text, f"{name} has no example"
    example = doctest.DocTestParser().get_doctest(text, space, name, None, None)
    report: list[str] = []
    failed, _ = doctest.DocTestRunner().run(example, out=report.append)
    assert not failed, "".join(report)


def test_the_table_of_stable_names_is_complete() -> None:
    page = Path(__file__).parents[1] / "docs" / "reference" / "api" / "index.md"
    rows = "\n".join(row for row in page.read_text("utf-8").split("\n") if row.startswith("|"))
    listed = {name.rpartition(".")[2] for name in re.findall(r"`~?([\w.]+)`", rows)}
    stable = {*lis_grasp.__all__, *pipeline.__all__, "drake", *drake.__all__}
    assert stable - {"__version__"} == listed
