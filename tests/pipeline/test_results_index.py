"""Index page of several runs: its pictures, numbers and links."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.pipeline.results_index import write_index
from lis_grasp.visualization.thumbnail import svg_of


@pytest.mark.parametrize("extents", [(0.06, 0.06, 0.06), (0.03, 0.05, 0.2)])
def test_the_picture_of_a_convex_body_fills_its_outline_once(
    extents: tuple[float, float, float],
) -> None:
    body = trimesh.creation.box(extents).subdivide().subdivide()
    body.vertex_attributes["uncertainty"] = np.linspace(0.0, 0.01, len(body.vertices))
    svg = svg_of(body)
    paths = re.findall(r"M(\d+) (\d+)L(\d+) (\d+)L(\d+) (\d+)z", svg)
    faces = np.array(paths, dtype=float).reshape(-1, 3, 2)
    (a, b, c) = np.moveaxis(faces, 1, 0)
    areas = 0.5 * np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1)))
    # Corners are rounded to pixels: an error of half a pixel along the outline.
    assert areas.sum() == pytest.approx(ConvexHull(faces.reshape(-1, 2)).volume, rel=0.01)
    width, height = map(int, re.findall(r'viewBox="0 0 (\d+) (\d+)"', svg)[0])
    assert max(width, height) == 400
    assert faces.min() == 0.0
    assert len(set(re.findall(r"rgb\([\d,]+\)", svg))) > 5


def test_a_folder_without_runs_has_no_index(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="no folders of runs"):
        write_index(tmp_path)


@pytest.mark.slow
def test_a_run_of_two_objects_links_the_page_of_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["run", "box", "cylinder", "--known", "--prober", "kinematic", "--hand", "wsg50"]
    assert main([*command, "--touches", "8", "--output", "two"]) == 0
    page = (tmp_path / "two" / "index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([^"]+)"', page)
    assert links == ["box/scene.html", "cylinder/scene.html"]
    assert all((tmp_path / "two" / link).exists() for link in links)
    assert page.count("<svg") == 2
    assert page.count("<dt>8</dt><dd>touches</dd>") == 2


@pytest.mark.parametrize("further", [["a/box"], ["sphere", "--watch"]])
def test_several_objects_need_names_of_their_own_and_no_watching(
    further: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "box", *further]) == 2
    assert "several objects" in capsys.readouterr().err
