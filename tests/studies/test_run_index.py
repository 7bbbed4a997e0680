"""Index page of several runs: its pictures, numbers and links."""

import re
from pathlib import Path

import pytest

from lis_grasp.cli.main import main
from lis_grasp_studies.figures import run_index


@pytest.mark.slow
def test_the_index_of_a_run_of_two_objects_links_the_page_of_each(tmp_path: Path) -> None:
    command = ["run", "box", "cylinder", "--known", "--prober", "kinematic", "--hand", "wsg50"]
    assert main([*command, "--touches", "8", "--output", str(tmp_path)]) == 0
    assert run_index.main([str(tmp_path)]) == 0
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([^"]+)"', page)
    assert links == ["box/scene.html", "cylinder/scene.html"]
    assert all((tmp_path / link).exists() for link in links)
    assert page.count("<img") == 2
    assert page.count("<dt>8</dt><dd>touches</dd>") == 2


def test_a_folder_without_runs_has_no_index(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_index.main([str(tmp_path)]) == 1
    assert "no folders of runs" in capsys.readouterr().err


@pytest.mark.parametrize("further", [["a/box"], ["sphere", "--watch"]])
def test_several_objects_need_names_of_their_own_and_no_watching(
    further: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "box", *further]) == 2
    assert "several objects" in capsys.readouterr().err
