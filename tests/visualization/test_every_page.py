"""Every page that the package writes: it opens without an error, and something is drawn."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
import trimesh
from browser import CHROMIUM, Browser
from stations import station_with
from touch_recording import RADIUS, record, write_csv

from lis_grasp import pipeline
from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.pipeline import RunConfig, Scenario
from lis_grasp.results.page import write_scene_of
from lis_grasp.results.seen import see
from lis_grasp.robots.shipped_models import HAND_NAMES
from lis_grasp.views import draw_camera_pose, simulate_view
from lis_grasp.visualization import Scene
from lis_grasp.visualization.view_layers import SeenSurface

ROOT = Path(__file__).parents[2]

# Functions that make whole pages, and the files that call them. A new caller needs a page below.
WRITERS = {
    "build_page(": {"visualization/scene.py", "visualization/hand_layers.py"},
    "write_page(": {"evaluation/page.py", "paper/report.py", "study/cases.py"},
    "<!doctype html": {
        "visualization/_page.py",
        "visualization/assets/follow.html",
        "harness/page.py",
        "results/seen.py",
        "figures/run_index.py",
    },
}

slow = pytest.mark.slow
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt install chromium")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as one:
        yield one


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the folders of a run, and of its stages alone."""
    folder = tmp_path_factory.mktemp("results")
    config = RunConfig("box", hand="wsg50", prober="kinematic", touches=12, estimator="gpis")
    pipeline.run(config, folder / "run")
    for name, files in {
        "explored": ("contacts.ply", "touches.jsonl"),
        "estimated": ("contacts.ply", "surface.ply"),
        "planned": ("surface.ply", "grasps.json"),
    }.items():
        (folder / name).mkdir()
        for file in files:
            shutil.copy(folder / "run" / file, folder / name)
    return folder


def drawn(browser: Browser, page: Path, fragment: str = "", size: tuple[int, int] = (480, 360)):
    """Return which pixels differ from those of the table alone, (H, W)."""
    pictures = []
    for layers in ("&layers=", ""):
        browser.open(f"{page.as_uri()}#panel=0{fragment}{layers}", size)
        assert not browser.complaints
        assert browser.evaluate("document.getElementById('trouble').hidden")
        pictures.append(browser.picture())
    return np.abs(pictures[0] - pictures[1]).max(axis=2) > 0.1


def test_every_writer_of_pages_is_tested_here() -> None:
    files = [f for p in ("lis_grasp", "lis_grasp_studies") for f in (ROOT / p).rglob("*")]
    texts = {
        f: f.read_text(encoding="utf-8").lower()
        for f in files
        if f.suffix in (".py", ".html", ".js")
    }
    for call, known in WRITERS.items():
        found = {
            f"{file.parent.name}/{file.name}".replace("assets/", "visualization/assets/")
            for file, text in texts.items()
            if re.search(rf"(?<!def ){re.escape(call)}", text)
        }
        assert found == known


@slow
@needs_browser
@pytest.mark.parametrize("folder", ["run", "explored", "estimated", "planned"])
def test_results_are_drawn(browser: Browser, results: Path, folder: str) -> None:
    page = results / folder / "scene.html"
    if not page.exists():
        write_scene_of(page.parent)  # as `lis-grasp view` does
    assert drawn(browser, page).mean() > 0.005


@slow
@needs_browser
@pytest.mark.parametrize("hand", HAND_NAMES)
def test_a_hand_alone_is_drawn(browser: Browser, tmp_path: Path, hand: str) -> None:
    page = tmp_path / f"{hand}.html"
    assert main(["hand", "view", hand, "--output", str(page)]) == 0
    assert drawn(browser, page).mean() > 0.02


@slow
@needs_browser
@pytest.mark.parametrize("size", [(1280, 800), (560, 800), (1920, 1080)])
def test_a_hand_and_its_marks_are_inside_the_window(
    browser: Browser, tmp_path: Path, size: tuple[int, int]
) -> None:
    page = tmp_path / "allegro.html"
    assert main(["hand", "view", "allegro", "--output", str(page)]) == 0
    wide = size[0] > 640
    browser.open(f"{page.as_uri()}#panel={1 if wide else 'fold'}&t=0.5", size)
    picture = browser.picture()
    chroma, dark = np.ptp(picture, axis=2), picture.max(axis=2) < 0.45
    hand = (dark & (chroma < 0.12)) | (chroma > 0.4)  # links, or marks
    left = round(browser.box("#panel")[2]) + 2 if wide else 0
    top = 0 if wide else round(browser.box("#panel")[3]) + 2
    beside = hand[top : round(browser.box("#dock")[1]) - 2, left:]
    assert beside.mean() > 0.02
    assert not beside[:, -2:].any()
    assert not beside[:2].any()


@slow
@needs_browser
def test_what_a_camera_saw_is_drawn(browser: Browser, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    box = trimesh.creation.box([0.06, 0.06, 0.06])
    box.apply_translation([0.0, 0.0, 0.03])
    see(simulate_view([box], draw_camera_pose([0.0, 0.0, 0.03], rng=rng), rng=rng), 0.0, tmp_path)
    browser.open((tmp_path / "seen.html").as_uri(), (640, 800))
    assert not browser.complaints
    assert (browser.picture().min(axis=2) < 0.9).mean() > 0.05  # not white


@slow
@needs_browser
def test_grasps_are_above_the_fold_with_a_camera(browser: Browser, tmp_path: Path) -> None:
    known = Scenario.from_config(RunConfig("box", hand="wsg50", prober="kinematic", camera=True))
    given = known.agent.perception.prior.given(Contacts.empty())
    (view,) = known.agent.seen_by
    scene = scenes.scene(
        seen=SeenSurface(view, given.seen, given.guesses),
        headline=[(str(number), "of a run with a camera") for number in range(6)],
        summary=["a line"],
    )
    scene.save(tmp_path / "scene.html")
    browser.open((tmp_path / "scene.html").as_uri(), (1280, 800))
    first = browser.box('#panel input[data-layer^="grasp-"]')
    assert browser.box("#panel")[1] < first[1] < first[3] < browser.box("#panel")[3] < 800
    assert browser.box("figure")[1] > first[3]


@slow
@needs_browser
def test_an_arm_is_drawn(browser: Browser, tmp_path: Path) -> None:
    station = station_with("wsg50")
    touches = scenes.touches()
    posture = station.hand.probe_postures[station.hand.fingers[0]].joint_positions
    pose = replace(touches[0].hand_pose, joint_positions=posture)
    scene = Scene(
        truth=trimesh.creation.box([0.06, 0.06, 0.06]),
        contacts=scenes.contacts(),
        touches=[replace(touch, hand_pose=pose) for touch in touches],
        hand=station.hand,
        station=station,
    )
    scene.save(tmp_path / "scene.html")
    assert drawn(browser, tmp_path / "scene.html").mean() > 0.02


@slow
@needs_browser
def test_contacts_of_a_log_are_drawn(browser: Browser, tmp_path: Path) -> None:
    log = write_csv(record(), tmp_path / "log.csv")
    command = ["contacts", str(log), "--tip", "tip", "--object-pose", "object", "--tip-radius"]
    assert main([*command, str(RADIUS), "--output", str(tmp_path / "out")]) == 0
    write_scene_of(tmp_path / "out")
    assert drawn(browser, tmp_path / "out" / "scene.html").mean() > 5e-4


@slow
@needs_browser
def test_reports_show_their_tables_and_pictures(browser: Browser, tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from lis_grasp_studies.harness.page import Picture, write_page
    from lis_grasp_studies.harness.tables import Table

    table = Table("rates", "Rates", ("estimator", "held"), (("blend", "0.9"),))
    picture = Picture.of("A chart", "Its caption", Figure())
    write_page(tmp_path / "report.html", "A report", [table.section(), picture.html()])
    look_at_report(browser, tmp_path / "report.html", pictures=1)
    assert browser.evaluate("document.querySelectorAll('td').length") == 2


@slow
@needs_browser
def test_an_index_of_runs_shows_their_pictures(browser: Browser, results: Path) -> None:
    from lis_grasp_studies.figures.run_index import write_index

    look_at_report(browser, write_index(results), pictures=1)


def look_at_report(browser: Browser, page: Path, *, pictures: int) -> None:
    browser.open(page.as_uri(), (900, 700))
    assert not browser.complaints
    widths = browser.evaluate("[...document.images].map((image) => image.naturalWidth)")
    assert len(widths) == pictures
    assert min(widths) > 0
    assert float(np.ptp(browser.picture(), axis=(0, 1)).max()) > 0.3
