"""Figures of a run: page sizes, sizes of type, and what they need."""

import re
from pathlib import Path

import pytest
from matplotlib.text import Text

from lis_grasp import pipeline
from lis_grasp.pipeline import Run, RunConfig
from lis_grasp_studies.figures import bars, run_figures
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


def test_figures_of_a_run_are_as_wide_as_a_page_and_as_a_column(
    folder: Path, tmp_path: Path
) -> None:
    assert run_figures.main([str(folder), "--figures", str(tmp_path)]) == 0
    assert _width((tmp_path / "run.pdf").read_bytes()) == pytest.approx(WIDTH, abs=0.01)
    assert _width((tmp_path / "run_one_column.pdf").read_bytes()) == pytest.approx(COLUMN, abs=0.01)
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_type_in_a_column_is_not_smaller_than_on_a_page(folder: Path) -> None:
    stages = [(6, Run.load(folder).mesh)]
    charts = bars({"lis": {"box": [1.0]}}, title="t", ylabel="mm", width=COLUMN)
    assert _width(pdf_of(charts)) == pytest.approx(COLUMN, abs=0.01)
    for figure in (charts, run_figures._drawn(Run.load(folder), stages, COLUMN)):
        sizes = [t.get_fontsize() for t in figure.findobj(Text) if t.get_text()]
        assert min(sizes) >= SMALL


def test_a_folder_without_an_estimate_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_figures.main([str(tmp_path)]) == 1
    assert "run_figures: " in capsys.readouterr().err
