"""Scenes in a browser: layers, time line, player and overlay, on desktops and phones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep

import numpy as np
import pytest
import scenes
from browser import CHROMIUM, PHONE, Browser

from lis_grasp.exploration import LoggedProbe, Observation
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.visualization import Scene
from lis_grasp.visualization._story import Story
from lis_grasp.visualization.colours import VIRIDIS, srgb
from lis_grasp.world import Body, Surroundings

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt install chromium"),
]

STORY = Story.of(contacts=6, surfaces=[3, 6], grasps=2, lift_seconds=2.0)
TOUCH, GRASP, LIFT = STORY.chapters
STEP = TOUCH.facts["step"]

# Hues [deg] of what nothing else on the page has: contacts, normals, the true object, the estimate.
RED, ORANGE, BLUE, GREEN = (345.0, 15.0), (20.0, 40.0), (205.0, 225.0), (80.0, 175.0)


def _share(picture: np.ndarray, hue: tuple[float, float], saturation: float = 0.35) -> float:
    """Return the share of pixels whose hue [deg] lies in an interval (through 360 if needed)."""
    return float(np.mean(_of_hue(picture, hue, saturation)))


def _of_hue(picture: np.ndarray, hue: tuple[float, float], saturation: float) -> np.ndarray:
    high, low = picture.max(axis=2), picture.min(axis=2)
    chroma = np.maximum(high - low, 1e-12)
    r, g, b = np.moveaxis(picture, 2, 0)
    angle = np.select(
        [high == r, high == g], [(g - b) / chroma, 2.0 + (b - r) / chroma], 4.0 + (r - g) / chroma
    )
    turn = (60.0 * angle - hue[0]) % 360.0
    vivid = (high - low) > saturation * np.maximum(high, 1e-12)
    return vivid & (turn <= (hue[1] - hue[0]) % 360.0)


def _dark(picture: np.ndarray) -> float:
    """Return the share of pixels as dark as the hand, and as grey."""
    grey = np.ptp(picture, axis=2) < 0.12
    return float(np.mean((picture.max(axis=2) < 0.4) & grey))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as one:
        yield one


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return _write(scenes.scene(), tmp_path_factory.mktemp("scene"))


def _write(scene: Scene, directory: Path) -> str:
    path = directory / "scene.html"
    write_text(path, scene.html())  # at once: a page that follows reads no half of it
    return path.as_uri()


def _look(browser: Browser, page: str, fragment: str) -> np.ndarray:
    browser.open(f"{page}#panel=0&{fragment}", (480, 360))
    assert not browser.complaints
    return browser.picture()


def _time(browser: Browser) -> float:
    return float(browser.evaluate("Number(document.getElementById('time').value)"))


# ---- layers ---------------------------------------------------------------------------------


def test_every_layer_draws_its_own_colour_and_no_other(browser: Browser, page: str) -> None:
    own = {"estimate": GREEN, "contacts": RED, "normals": ORANGE, "truth": BLUE}
    bare = _look(browser, page, "layers=")
    for hue in own.values():
        assert _share(bare, hue) < 1e-4
    for layer, hue in own.items():
        picture = _look(browser, page, f"layers={layer}")
        assert _share(picture, hue) > 5e-4
        for other, strange in own.items():
            if other != layer and (layer, other) != ("estimate", "truth"):  # it has blue as well
                assert _share(picture, strange) < 3e-4
    hand = _look(browser, page, "layers=hand,grasp-1")
    assert _dark(hand) > _dark(bare) + 0.02


@pytest.mark.parametrize(
    ("layer", "hue"), [("estimate", GREEN), ("contacts", RED), ("normals", ORANGE)]
)
def test_switching_a_layer_off_takes_its_pixels_away(
    browser: Browser, page: str, layer: str, hue: tuple[float, float]
) -> None:
    layers = "estimate,contacts,normals"
    browser.open(f"{page}#layers={layers}&t={TOUCH.end}", (900, 700))
    scene = slice(310, None)  # right of the panel, above the legend
    before = browser.picture()[:500, scene]
    browser.press(f"[data-layer='{layer}']")
    without = browser.picture()[:500, scene]
    browser.press(f"[data-layer='{layer}']")
    again = browser.picture()[:500, scene]
    assert _share(before, hue) > 2e-4
    assert _share(without, hue) < 0.05 * _share(before, hue)
    assert _share(again, hue) == pytest.approx(_share(before, hue), rel=0.02)


def test_the_true_object_is_glass_round_the_estimate_and_solid_without_it(
    browser: Browser, page: str
) -> None:
    glass = _look(browser, page, "layers=truth,estimate&t=0")
    solid = _look(browser, page, "layers=truth&t=0")
    assert _share(solid, BLUE) > 0.1
    assert _share(glass, BLUE) < 0.1 * _share(solid, BLUE)
    assert np.abs(glass - _look(browser, page, "layers=&t=0")).max(axis=2).mean() > 0.005


def test_the_path_of_a_moved_object_is_a_layer_of_the_touches(
    browser: Browser, tmp_path: Path
) -> None:
    poses = [scenes.pose(0.004 * k, 0.004 * k, 0.0) for k in range(4)]
    moved = tuple(
        LoggedProbe(Observation(touch, replace(PoseBelief.start(), X_WE=X)), np.eye(4))
        for touch, X in zip(scenes.touches(), poses, strict=False)
    )
    page = _write(scenes.scene(moved=moved), tmp_path)
    for time, visible in ((TOUCH.end, True), (GRASP.end, False), (LIFT.end, False)):
        shown, hidden = (_look(browser, page, f"layers={on}&t={time}") for on in ("motion", ""))
        assert bool((np.abs(shown - hidden).max(axis=2) > 0.1).mean() > 1e-4) == visible


# ---- time -----------------------------------------------------------------------------------


def test_the_estimate_is_absent_at_first_grows_and_is_there_after_the_touches(
    browser: Browser, page: str
) -> None:
    moments = {0.0: 0, 2.5 * STEP: 2, 3.0 * STEP: 3, 5.5 * STEP: 5, TOUCH.end: 6}
    seen, dots = [], []
    for time, contacts in moments.items():
        picture = _look(browser, page, f"layers=estimate&t={time}")
        seen.append(float(np.mean(np.ptp(picture, axis=2) > 0.25)))
        count = "document.getElementById('caption').textContent"
        words = browser.evaluate(count)
        assert words.startswith(f"Touch {contacts} of 6" if contacts else "No contacts")
        dots.append(_share(_look(browser, page, f"layers=contacts&t={time}"), RED))
    assert seen[0] == seen[1] < 1e-4  # the first estimate is made from three contacts
    assert seen[2] == pytest.approx(seen[3], rel=0.01) and seen[2] > 0.01  # noqa: PT018
    assert seen[4] > 1.5 * seen[2]  # which is half as wide as the last one
    assert dots[0] < 1e-5 < dots[1]
    assert dots[1] < dots[-1]
    # No contact is ahead of the estimate: five touches are made, the estimate is from three.
    assert dots[3] == pytest.approx(dots[2], rel=0.01)


def test_the_result_is_read_without_scrolling(browser: Browser, page: str) -> None:
    browser.open(f"{page}#panel=1", (1280, 600))
    bottom = "document.querySelector('.lines').getBoundingClientRect().bottom"
    assert 0.0 < browser.evaluate(bottom) < 300.0


def test_the_hand_comes_in_touches_and_stays_at_the_last(browser: Browser, page: str) -> None:
    shares = []
    for touches in (3.2, 3.6, 4.0, 4.2, 6.9):
        picture = _look(browser, page, f"layers=hand&zoom=0.4&t={touches * STEP}")
        shares.append(_dark(picture))
    none = _dark(_look(browser, page, "layers=&zoom=0.4&t=0"))
    assert min(shares) > none + 0.005


def test_the_hand_at_a_touch_is_where_its_pose_says(browser: Browser, page: str) -> None:
    rows = {}
    for touch in (3, 6):  # at the top of the box and at its bottom
        picture = _look(browser, page, f"layers=hand&zoom=0.4&t={touch * STEP}")
        grey = (picture.max(axis=2) < 0.4) & (np.ptp(picture, axis=2) < 0.12)
        rows[touch] = np.argwhere(grey)[:, 0].mean()
    assert rows[3] < rows[6] - 10.0


def test_candidate_grasps_take_turns_the_best_one_last(browser: Browser, page: str) -> None:
    layers = "layers=hand,grasp-1,grasp-2"
    second = _look(browser, page, f"{layers}&t={GRASP.start + 0.7}")
    best = _look(browser, page, f"{layers}&t={GRASP.end}")
    both = _look(browser, page, f"{layers},together&t={GRASP.end}")
    tinted = [_share(p, ORANGE) for p in (second, best, both)]
    assert tinted[0] > 0.02
    assert tinted[1] < 1e-3
    assert tinted[2] > 0.01
    assert _dark(best) > 0.02
    hidden = _look(browser, page, f"layers=hand,grasp-1&t={GRASP.start + 0.7}")
    assert _share(hidden, ORANGE) < 1e-4


def test_a_grasp_that_is_ticked_is_looked_at(browser: Browser, page: str) -> None:
    browser.open(f"{page}#layers=hand,grasp-1", (900, 700))
    assert _time(browser) == pytest.approx(STORY.rest)
    browser.press("[data-layer='grasp-2']")
    assert GRASP.start < _time(browser) < GRASP.start + 1.4
    assert browser.evaluate("document.getElementById('caption').textContent").startswith(
        "Grasp 2 of 2"
    )


def test_the_lift_really_lifts_the_true_object(browser: Browser, page: str) -> None:
    heights = []
    for time in (0.9, 2.0):
        picture = _look(browser, page, f"t={LIFT.start + time}")
        assert _share(picture, GREEN) < 1e-3  # the estimate has made way for the object
        blue = picture[..., 2] - picture[..., 0] > 0.15
        assert blue.mean() > 0.01
        heights.append(np.argwhere(blue)[:, 0].mean() / len(picture))
    # The view is the same from 0.4 s on; 10 cm of about 30 cm in view is a third of the picture.
    assert heights[0] - heights[1] > 0.15


def test_without_the_lift_everything_stays_where_it_was(browser: Browser, page: str) -> None:
    layers = "layers=truth,hand,grasp-1"
    for time in (1.0, 2.0):
        resting = _look(browser, page, f"{layers}&t={LIFT.start + time}")
        blue = np.argwhere(_of_hue(resting, BLUE, 0.35))[:, 0].mean()
        if time == 1.0:
            first = blue
    assert blue == pytest.approx(first, abs=1.0)


# ---- playing --------------------------------------------------------------------------------


def test_play_tells_the_story_from_its_beginning_and_pauses(browser: Browser, page: str) -> None:
    browser.open(page, (900, 700))
    assert _time(browser) < STORY.rest  # it plays
    browser.open(f"{page}#panel=1", (900, 700))
    assert _time(browser) == pytest.approx(STORY.rest)
    browser.press("#play")
    assert _time(browser) < STORY.rest / 2.0
    before = _time(browser)
    browser.wait_for(f"Number(document.getElementById('time').value) > {before}")
    browser.press("#play")
    paused = _time(browser)
    browser.evaluate("new Promise((r) => setTimeout(() => r(0), 300))")
    assert _time(browser) == paused
    assert browser.evaluate("document.getElementById('play').ariaLabel") == "Play"


def test_a_story_that_is_played_ends_and_can_be_played_again(browser: Browser, page: str) -> None:
    browser.open(f"{page}#t={STORY.duration - 0.05}&play=1", (900, 700))
    browser.wait_for(f"Number(document.getElementById('time').value) >= {STORY.duration} - 1e-6")
    assert _time(browser) == pytest.approx(STORY.duration)
    assert browser.evaluate("document.getElementById('play').ariaLabel") == "Play again"
    browser.press("#play")
    assert _time(browser) < STORY.duration / 2.0


def test_chapters_lead_to_where_they_begin(browser: Browser, page: str) -> None:
    browser.open(f"{page}#panel=1", (900, 700))
    for number, chapter in enumerate(STORY.chapters):
        browser.press(f"[data-chapter='{number}']")
        assert _time(browser) == pytest.approx(chapter.start, abs=2e-3)
        current = "[...document.querySelectorAll('[aria-current=true]')].map((b) => b.textContent)"
        assert browser.evaluate(current) == [chapter.label]


# ---- on a phone -----------------------------------------------------------------------------


@pytest.mark.parametrize("size", [PHONE, (320, 568), (844, 390), (768, 1024), (1400, 900)])
def test_legend_and_player_are_in_view(
    browser: Browser, page: str, size: tuple[int, int], tmp_path: Path
) -> None:
    browser.open(f"{page}#layers=contacts,estimate", size, touch=size[0] < 1000)
    for part in ("#legend .bar", "#legend .ticks", "#play", "#time", "#caption", "summary h1"):
        left, top, right, bottom = browser.box(part)
        assert 0 <= left < right <= size[0]
        assert 0 <= top < bottom <= size[1]
    left, top, right, bottom = (round(v) for v in browser.box("#legend .bar"))
    row = browser.picture()[(top + bottom) // 2, left:right]
    assert len(row) > 150
    # The ends are round; a tenth of the way in, the colours are the map's.
    for share, colour in ((0.0625, VIRIDIS[1]), (0.5, VIRIDIS[8]), (0.9375, VIRIDIS[15])):
        assert np.abs(row[round(share * (len(row) - 1))] - srgb(colour)).max() < 0.03
    scrolls = "document.scrollingElement.scrollWidth > window.innerWidth"
    assert not browser.evaluate(scrolls)


def test_a_phone_names_the_colours_without_unfolding_anything(browser: Browser, page: str) -> None:
    browser.open(f"{page}#t={STORY.rest}", PHONE, touch=True)
    assert not browser.evaluate("document.getElementById('panel').open")
    left, top, right, bottom = (round(v) for v in browser.box(".chips"))
    chips = browser.picture()[top:bottom, left:right]
    for hue in (RED, ORANGE, BLUE):
        assert _share(chips, hue) > 1e-3
    named = "[...document.querySelectorAll('.chips li')].map((c) => c.innerText)"
    assert browser.evaluate(named) == ["True object", "6 contacts", "Normals"]


def test_a_finger_plays_scrubs_and_switches_layers(browser: Browser, page: str) -> None:
    browser.open(f"{page}#t=0", PHONE, touch=True)
    left, top, right, bottom = browser.box("#time")
    middle = (top + bottom) / 2.0
    browser.swipe((left + 9.0, middle), (left + 0.5 * (right - left), middle))
    assert _time(browser) == pytest.approx(0.5 * STORY.duration, rel=0.1)
    browser.tap("#play")
    assert browser.evaluate("document.getElementById('play').className") == "playing"
    browser.tap("#play")
    browser.tap("[data-chapter='0']")
    assert _time(browser) == 0.0
    browser.tap("summary")
    assert browser.evaluate("document.getElementById('panel').open")
    browser.tap("[data-layer='truth']")
    assert not browser.evaluate("document.querySelector('[data-layer=truth]').checked")


def test_what_a_finger_has_to_hit_is_large_enough(browser: Browser, page: str) -> None:
    browser.open(f"{page}#panel=1", PHONE, touch=True)
    # 24 by 24 CSS pixels is the least that WCAG 2.2 allows (2.5.8); a common advice is 44.
    for part in ("#play", "summary", ".layers label", "[data-chapter='0']", "[data-chapter='2']"):
        left, top, right, bottom = browser.box(part)
        assert bottom - top >= 36.0
        assert right - left >= 44.0


def test_a_finger_turns_the_object(browser: Browser, page: str) -> None:
    browser.open(f"{page}#layers=truth", PHONE, touch=True)
    before = browser.picture()[100:500]
    browser.swipe((120.0, 300.0), (260.0, 300.0))
    assert np.mean(np.abs(browser.picture()[100:500] - before).max(axis=2) > 0.05) > 0.02


# ---- alone ----------------------------------------------------------------------------------


def test_a_page_asks_nobody_for_anything(browser: Browser, page: str) -> None:
    browser.open(f"{page}#play=1", (700, 700))  # a size of its own: loaded, not only shown
    browser.evaluate("new Promise((r) => setTimeout(() => r(0), 500))")
    foreign = [url for url in browser.requested if not url.startswith(("data:", "blob:", "about:"))]
    assert [url.split("#")[0] for url in foreign] == [page]
    assert not browser.complaints


def test_names_that_look_like_markup_stay_text(browser: Browser, tmp_path: Path) -> None:
    evil = "<img src=x onerror=\"document.title='run'\"><script>document.title='run'</script>"
    browser.open(_write(scenes.scene(title=evil, summary=(evil,)), tmp_path), (900, 700))
    assert browser.evaluate("document.querySelector('h1').textContent") == evil
    assert browser.evaluate("document.title") == evil
    assert browser.evaluate("document.querySelectorAll('img').length") == 0


def test_the_server_shows_the_same_as_the_file(browser: Browser, page: str, tmp_path: Path) -> None:
    _write(scenes.scene(), tmp_path)
    fragment = f"panel=0&t={TOUCH.end}"
    file = _look(browser, page, fragment)
    with scenes.served(tmp_path) as server:
        served = _look(browser, server.address, fragment)
    assert np.abs(served - file).max() < 0.02


def test_a_followed_scene_goes_on_where_it_was(browser: Browser, tmp_path: Path) -> None:
    frame = "document.querySelector('iframe.shown')?.contentWindow.lisGrasp?.now"

    def wait(condition: str) -> None:
        end = monotonic() + 60.0
        while not browser.evaluate(f"Boolean({condition})"):
            assert monotonic() < end, condition
            sleep(0.1)

    with scenes.served(tmp_path, follow=True) as server:
        browser.send("Page.navigate", url=server.address)
        wait("document.getElementById('waiting')")
        _write(Scene(truth=scenes.box()), tmp_path)  # before the first touch
        wait(f"{frame} && !document.getElementById('waiting').hidden")
        _write(replace(scenes.scene(), grasps=(), motion=None), tmp_path)
        wait(f"{frame}?.chapter === 'touch' && {frame}.turn > 1")
        assert browser.evaluate("document.getElementById('waiting').hidden")
        first = browser.evaluate("document.querySelector('iframe.shown').src")
        _write(scenes.scene(), tmp_path)
        wait(f"document.querySelector('iframe.shown').src !== {first!r} && {frame}")
        assert browser.evaluate(f"{frame}.chapter !== 'touch' || {frame}.turn > 1")
        wait(f"{frame}.chapter === 'lift'")


def test_pages_of_one_thing_alone_draw_it(browser: Browser, tmp_path: Path) -> None:
    alone = {
        "truth": (Scene(truth=scenes.box()), BLUE),
        "estimate": (Scene(estimate=scenes.estimate()), GREEN),
        "contacts": (Scene(contacts=scenes.contacts()), RED),
    }
    for name, (scene, hue) in alone.items():
        (tmp_path / name).mkdir()
        assert _share(_look(browser, _write(scene, tmp_path / name), ""), hue) > 0.001


MAUVE = (305.0, 335.0)  # of free bodies


def test_bodies_beside_the_object_are_glass_with_layers_of_their_own(
    browser: Browser, tmp_path: Path
) -> None:
    """The hand is as dark behind a body as without it; each layer can be hidden."""
    crate = Body.box("crate", (0.08, 0.08, 0.12), (0.12, 0.0, 0.0), mass=0.2)
    walls = [Body.box(f"wall {y}", (0.5, 0.01, 0.3), (0.0, y, 0.1)) for y in (-0.15, 0.15)]
    page = tmp_path / "beside.html"
    replace(scenes.scene(), surroundings=Surroundings((crate, *walls))).save(page)
    at = f"{page.as_uri()}#t={GRASP.end}&panel=0&zoom=0.6&layers=hand,grasp-1"
    pictures = {}
    for layers in ("", ",surroundings", ",free-bodies"):
        browser.open(at + layers, (1280, 800))
        pictures[layers] = browser.picture()
    assert not browser.complaints
    alone, walled, crated = pictures.values()
    assert _share(alone, MAUVE, 0.05) < 1e-4
    assert _share(crated, MAUVE, 0.05) > 5e-4  # over the table the glass has the table's hue
    assert _share(walled, MAUVE, 0.05) < 1e-4
    changed = np.abs(walled - alone).max(axis=2) > 0.02
    assert changed.mean() > 0.05  # the walls are drawn
    assert _dark(walled) > 0.5 * _dark(alone)  # and the hand is seen through them
