"""Figure of a run: page sizes, sizes of type, formats, and what it needs."""

import argparse
import re
import shutil
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest
from matplotlib.text import Text
from PIL import Image

from lis_grasp import pipeline
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.pipeline import Run, RunConfig
from lis_grasp_studies.cli import figure
from lis_grasp_studies.figures import bars
from lis_grasp_studies.figures.run_figures import DOTS_PER_INCH, run_figure
from lis_grasp_studies.figures.style import COLUMN, SMALL, WIDTH, pdf_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an exploration with an estimate and a grasp."""
    folder = tmp_path_factory.mktemp("figures") / "box"
    config = RunConfig("box", hand="wsg50", prober="kinematic", touches=6, estimator="gpis")
    pipeline.explore_object(config, folder)
    source = pipeline.ContactSource(folder / "contacts.ply")
    estimated = pipeline.estimate_file([source], folder)
    pipeline.grasp_file(estimated.path, folder, grasps=1)
    return folder


def _width(pdf: bytes) -> float:
    """Return the width of a page [in]."""
    found = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ", pdf)
    assert found
    return float(found[1]) / 72.0


def _execute(*arguments: object) -> None:
    parser = argparse.ArgumentParser()
    figure.add_arguments(parser)
    options = parser.parse_args([str(argument) for argument in arguments])
    options.execute(options)


@pytest.mark.parametrize("width", [WIDTH, COLUMN])
def test_a_figure_is_as_wide_as_asked_in_every_format(
    folder: Path, tmp_path: Path, width: float
) -> None:
    for kind in ("pdf", "svg", "png"):
        _execute(folder, "--output", tmp_path / f"run.{kind}", "--width", width)
    assert _width((tmp_path / "run.pdf").read_bytes()) == pytest.approx(width, abs=0.01)
    svg = ElementTree.parse(tmp_path / "run.svg").getroot()
    assert float(svg.get("width").removesuffix("pt")) == pytest.approx(72.0 * width, abs=0.01)
    # Matplotlib cuts the last part of a pixel off.
    with Image.open(tmp_path / "run.png") as png:
        assert png.size[0] == pytest.approx(width * DOTS_PER_INCH, abs=1.0)


def test_a_figure_has_pictures_of_two_views_and_vector_text(folder: Path, tmp_path: Path) -> None:
    _execute(folder, "--output", tmp_path / "run.svg")
    drawn = (tmp_path / "run.svg").read_text()
    assert drawn.count("<image") == 2 * 3 + 1  # object, estimate, grasp; the colour bar
    assert "best grasp" in drawn  # in a comment beside its outlines
    _execute(folder, "--output", tmp_path / "again.svg")
    assert (tmp_path / "again.svg").read_text() == drawn


def _width(pdf: bytes) -> float:
    """Return the width of a page [in]."""
    found = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ", pdf)
    assert found
    return float(found[1]) / 72.0


def test_type_in_a_column_is_not_smaller_than_on_a_page(folder: Path) -> None:
    charts = bars({"lis": {"box": [1.0]}}, title="t", ylabel="mm", width=COLUMN)
    assert _width(pdf_of(charts)) == pytest.approx(COLUMN, abs=0.01)
    for drawn in (charts, run_figure(Run.load(folder), COLUMN)):
        sizes = [t.get_fontsize() for t in drawn.findobj(Text) if t.get_text()]
        assert min(sizes) >= SMALL


def test_without_the_true_object_there_are_estimate_and_grasp(tmp_path: Path) -> None:
    contacts = Path(__file__).parents[2] / "examples" / "contacts.csv"
    made = pipeline.estimate_file([pipeline.ContactSource(contacts)], tmp_path)
    pipeline.grasp_file(made.path, tmp_path, hand="wsg50", grasps=1)
    pictures = [axes for axes in run_figure(Run.load(tmp_path), WIDTH).axes if axes.images]
    assert len(pictures) == 2 * 2


@pytest.mark.parametrize("name", ["contacts.ply", "surface.ply", "grasps.json"])
def test_a_missing_file_of_a_stage_is_named(folder: Path, tmp_path: Path, name: str) -> None:
    shutil.copytree(folder, tmp_path / "run")
    (tmp_path / "run" / name).unlink()
    with pytest.raises(InvalidFileError) as error:
        _execute(tmp_path / "run", "--output", tmp_path / "run.pdf")
    assert error.value.path == tmp_path / "run" / name
    assert not (tmp_path / "run.pdf").exists()


def test_another_format_and_a_narrow_figure_are_refused(folder: Path, tmp_path: Path) -> None:
    for option, value in (("output", tmp_path / "run.jpg"), ("width", 1.0)):
        with pytest.raises(InvalidOptionError) as error:
            _execute(folder, f"--{option}", value)
        assert error.value.option == option


def test_the_verb_is_an_entry_point() -> None:
    tomllib = pytest.importorskip("tomllib")  # Python 3.10 has none
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert import_module(project["entry-points"]["lis_grasp.verbs"]["figure"]) is figure
