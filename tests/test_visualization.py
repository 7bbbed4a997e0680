"""Scenes: the page shows what it is given, loads nothing, runs nobody's markup, and draws."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import threading
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import umsgpack
from numpy.testing import assert_allclose

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.grasping.grasp import Grasp
from lis_grasp.grasping.hand import Hand, Joint, LinkGeometry, Pad
from lis_grasp.motion import Motion
from lis_grasp.visualization import Scene, SceneServer, show, write_scene
from lis_grasp.visualization.camera import box_corners, choose_azimuth, outermost, surface_points
from lis_grasp.visualization.colours import ColourScale, linear_rgb, round_up, viridis
from lis_grasp.visualization.drawing import animate, draw_mesh, material, shade
from lis_grasp.visualization.object_layers import _poses_along

HALF = 0.03


def _box() -> trimesh.Trimesh:
    return trimesh.creation.box((2 * HALF, 2 * HALF, 2 * HALF))


def _estimate() -> trimesh.Trimesh:
    mesh = _box().subdivide().subdivide()
    mesh.vertex_attributes["uncertainty"] = 1e-3 * (1.0 + mesh.vertices[:, 2] / HALF)  # 0 to 2 mm
    return mesh


def _contacts() -> Contacts:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    return Contacts(HALF * axes, axes, free_points=np.array([[0.1, 0.0, 0.0]]))


def _pose(x: float, y: float, z: float) -> np.ndarray:
    X = np.eye(4)
    X[:3, 3] = x, y, z
    return X


def _hand() -> Hand:
    """Return a palm above two fingers that slide along x."""
    fingers = ("left", "right")
    sides = (-1.0, 1.0)
    joints = tuple(
        Joint(f"{f}_joint", "prismatic", "palm", f, np.eye(4), np.array([s, 0.0, 0.0]), k)
        for k, (f, s) in enumerate(zip(fingers, sides, strict=True))
    )
    palm = LinkGeometry(
        "palm",
        _pose(0, 0, 0.11),
        "box",
        (0.14, 0.05, 0.03),
        trimesh.creation.box((0.14, 0.05, 0.03)),
    )
    size = (0.01, 0.02, 0.1)
    bars = tuple(
        LinkGeometry(f, _pose(0, 0, 0.05), "box", size, trimesh.creation.box(size)) for f in fingers
    )
    pads = tuple(
        Pad(f, f, np.zeros(3), 0.0, np.array([-s, 0.0, 0.0]), 0.3)
        for f, s in zip(fingers, sides, strict=True)
    )
    return Hand(
        name="pincers",
        kind="jaw",
        joint_names=("left_joint", "right_joint"),
        lower=np.zeros(2),
        upper=np.full(2, 0.1),
        effort_limits=np.ones(2),
        links=("palm", *fingers),
        joints=joints,
        inertials={},
        link_geometries=(palm, *bars),
        pads=pads,
        X_LH=np.eye(4),
        approach_H=np.array([0.0, 0.0, -1.0]),
        pregrasps={},
        probe_postures={},
        self_collision_exclusions=frozenset(),
        max_contact_force=10.0,
    )


def _grasp(opening: float = HALF + 0.005) -> Grasp:
    return Grasp(
        hand="pincers",
        X_OH=np.eye(4),
        joint_names=("left_joint", "right_joint"),
        joint_positions=np.full(2, opening),
        pregrasp_positions=np.full(2, 0.06),
        approach_O=np.array([0.0, 0.0, -1.0]),
        contact_points=np.array([[-HALF, 0.0, 0.0], [HALF, 0.0, 0.0]]),
        contact_normals=np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        contact_fingers=("left", "right"),
        contact_forces=np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
        quality={"epsilon": 0.125},
        accepted="force closure",
    )


def _motion(height: float = 0.1) -> Motion:
    times = np.linspace(0.0, 2.0, 201)
    lift = np.array([_pose(0, 0, z) for z in height * np.clip(times - 1.0, 0.0, 1.0)])
    hand = _hand().forward_kinematics(lift, np.full(2, HALF + 0.005))
    return Motion(times, {"object": lift, **hand})


def _scene(**changes: Any) -> Scene:
    content: dict[str, Any] = {
        "truth": _box(),
        "estimate": _estimate(),
        "contacts": _contacts(),
        "grasps": (_grasp(), _grasp(0.05)),
        "hand": _hand(),
        "motion": _motion(),
        "support_height": -HALF,
        "title": "A box",
        "summary": ("six touches",),
    }
    return Scene(**{**content, **changes})


def _facts(page: str) -> dict[str, Any]:
    text = re.search(r'<script type="application/json" id="scene-data">(.*?)</script>', page, re.S)
    assert text is not None
    return json.loads(text[1])


def _commands(page: str) -> list[dict[str, Any]]:
    return [umsgpack.unpackb(base64.b64decode(c)) for c in _facts(page)["commands"]]


def _without_viewer(page: str) -> str:
    return page[: page.index("<script>")] + page[page.rindex("<script>") :]


# ---- the page -------------------------------------------------------------------------------


def test_page_draws_every_layer_it_offers() -> None:
    page = _scene().html()
    offered = [layer["id"] for layer in _facts(page)["layers"]]
    assert offered == ["estimate", "truth", "contacts", "free", "grasp-1", "grasp-2", "lift"]
    assert re.findall(r'data-layer="([^"]+)"', page) == [
        "estimate", "truth", "contacts", "free", "lift", "grasp-1", "grasp-2",
    ]  # fmt: skip
    drawn = {c["path"] for c in _commands(page) if c["type"] == "set_object"}
    for path in ("object/estimate", "object/truth", "object/contacts/ball", "object/contacts/head",
                 "object/free", "hand/0/0", "hand/1/0", "hand/2/0", "table", "grid"):  # fmt: skip
        assert f"/lis_grasp/{path}" in drawn


def test_only_the_best_grasp_is_visible_at_first() -> None:
    on = {layer["id"]: layer["on"] for layer in _facts(_scene().html())["layers"]}
    assert on["grasp-1"]
    assert not on["grasp-2"]


def test_grasps_beyond_the_shown_ones_stay_out_of_the_page() -> None:
    page = _scene(grasps=(_grasp(),) * 7, shown_grasps=3).html()
    assert len(_facts(page)["grasps"]) == 3


def test_links_stand_where_the_kinematics_put_them() -> None:
    grasp = _grasp()
    hand = _hand()
    posture = _facts(_scene().html())["grasps"][0]
    expected = hand.forward_kinematics(grasp.X_OH, grasp.joint_positions)
    for matrix, link in zip(posture, hand.links, strict=True):
        # The page keeps seven decimals.
        assert_allclose(np.array(matrix).reshape(4, 4).T, expected[link], atol=1e-7)


def test_joints_are_matched_by_name_not_by_place() -> None:
    grasp = replace(_grasp(), joint_positions=np.array([0.01, 0.02]))
    swapped = replace(
        grasp, joint_names=("right_joint", "left_joint"), joint_positions=np.array([0.02, 0.01])
    )
    first, second = (_facts(_scene(grasps=(g,)).html())["grasps"] for g in (grasp, swapped))
    assert first == second


def test_equal_scenes_are_equal_bytes() -> None:
    assert _scene().html() == _scene().html()


def test_page_refers_to_nothing_outside_itself() -> None:
    page = _scene().html()
    own = re.sub(r'"[\w+/]{60,}=*"', '""', _without_viewer(page))  # drawing commands in base64
    assert len(own) < 50_000
    assert not re.search(r"""["'(=]\s*(?:https?:)?//""", own)
    assert not re.search(r"\b(?:src|href|action|data)\s*=", own)
    assert not re.search(r"\b(?:fetch|import|XMLHttpRequest|WebSocket|EventSource)\s*\(", own)
    assert "url(" not in own
    # The viewer's own text holds addresses only as names of XML dialects.
    assert set(re.findall(r"https?://[\w./]+", page)) <= {"http://www.w3.org/1999/xhtml"}


def test_page_forbids_itself_connections_and_foreign_scripts() -> None:
    page = _scene().html()
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert policy is not None
    rules = dict(rule.strip().split(" ", 1) for rule in policy[1].split(";"))
    assert rules["default-src"] == "'none'"
    assert "connect-src" not in rules
    assert re.fullmatch(r"('sha256-[\w+/]{43}=' ?){2}", rules["script-src"])


def test_text_is_escaped() -> None:
    evil = '</script><script>alert(1)</script>"&<b>'
    grasp = replace(_grasp(), quality={evil: 1.0, "epsilon": 0.1})
    page = _scene(title=evil, summary=(evil,), grasps=(grasp,)).html()
    assert "alert(1)</script>" not in page.replace("&lt;", "<x").replace("\\u003c", "<x")
    escaped = "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;&quot;&amp;&lt;b&gt;"
    assert page.count(escaped) == 4  # the page's title, the heading, the summary, the quality
    assert page.count("<script") == _scene().html().count("<script")


def test_notebook_frame_holds_the_page() -> None:
    scene = show(contacts=_contacts(), title='A "box"')
    frame = re.search(r'<iframe srcdoc="([^"]*)" title="A &quot;box&quot;"', scene._repr_html_())
    assert frame is not None
    text = frame[1]
    for entity, character in (("&lt;", "<"), ("&gt;", ">"), ("&quot;", '"'), ("&#x27;", "'")):
        text = text.replace(entity, character)
    assert text.replace("&amp;", "&") == scene.html()


def test_scene_is_written_whole(tmp_path: Path) -> None:
    write_scene(tmp_path / "new" / "scene.html", truth=_box(), title="A box")
    page = (tmp_path / "new" / "scene.html").read_text(encoding="utf-8")
    assert page == Scene(truth=_box(), title="A box").html()


@pytest.mark.parametrize("only", ["truth", "estimate", "contacts"])
def test_one_layer_alone_is_a_scene(only: str) -> None:
    content = {"truth": _box(), "estimate": _estimate(), "contacts": _contacts()}
    page = Scene(**{only: content[only]}).html()
    assert _facts(page)["layers"][0]["id"] == only
    assert 'id="player"' not in page


def test_a_single_contact_is_a_scene() -> None:
    page = Scene(contacts=_contacts().subset([0])).html()
    assert "1 contact and normals" in page
    assert not re.search(r"NaN|Infinity", json.dumps(_facts(page)["camera"]))


def test_nothing_to_show_is_refused() -> None:
    with pytest.raises(InvalidOptionError, match="none of them"):
        Scene(contacts=Contacts.empty())


@pytest.mark.parametrize("of_hand", [{"grasps": (1,)}, {"motion": 1}])
def test_grasps_and_motions_without_their_hand_are_refused(of_hand: dict[str, Any]) -> None:
    with pytest.raises(InvalidOptionError, match="give hand"):
        Scene(truth=_box(), **of_hand)


def test_grasps_of_another_hand_are_refused() -> None:
    with pytest.raises(InvalidOptionError, match="'claw', the hand to draw is 'pincers'"):
        _scene(grasps=(replace(_grasp(), hand="claw"),))


# ---- colours --------------------------------------------------------------------------------


def test_scale_runs_from_zero_to_the_next_round_millimetres() -> None:
    scale = ColourScale.of(np.linspace(0.0, 2.6e-3, 100))
    assert (scale.low, scale.high, scale.clipped) == (0.0, 3e-3, False)
    assert scale.tick_labels() == ["0", "0.75", "1.5", "2.25", "3 mm"]


def test_unknown_places_take_the_far_end_and_do_not_stretch_the_scale() -> None:
    values = np.append(np.full(99, 1e-3), np.inf)
    scale = ColourScale.of(values)
    assert scale.high == pytest.approx(1e-3)
    assert scale.clipped
    assert scale.tick_labels()[-1] == "≥ 1 mm"
    assert_allclose(scale.colours([np.inf, np.nan, 5.0]), viridis([1.0, 1.0, 1.0]))


def test_a_surface_without_any_known_uncertainty_has_no_legend() -> None:
    mesh = _estimate()
    mesh.vertex_attributes["uncertainty"] = np.full(len(mesh.vertices), np.inf)
    assert "Uncertainty of the surface" in _scene().html()
    assert "Uncertainty of the surface" not in _scene(estimate=mesh).html()


def test_a_scale_without_length_is_refused() -> None:
    with pytest.raises(InvalidOptionError, match="low < high"):
        ColourScale(1e-3, 1e-3)


def test_lightness_grows_along_the_map() -> None:
    weights = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear sRGB
    assert np.all(np.diff(linear_rgb(viridis(np.linspace(0, 1, 200))) @ weights) > 0.0)


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, 1.0), (1.01, 2.0), (0.0021, 0.003), (9.1, 10.0), (70.0, 80.0)]
)
def test_rounding_up_stops_at_the_next_round_number(value: float, expected: float) -> None:
    assert round_up(value) == pytest.approx(expected, rel=1e-12)


# ---- geometry -------------------------------------------------------------------------------


def test_a_box_is_shaded_flat() -> None:
    vertices, faces, normals, source = shade(_box())
    assert len(vertices) == 24  # three normals at each of eight corners
    assert_allclose(vertices, _box().vertices[source])
    flat = np.repeat(_box().face_normals, 3, axis=0)
    assert_allclose(normals[faces.ravel()], flat, atol=1e-12)


def test_a_sphere_is_shaded_smooth() -> None:
    sphere = trimesh.creation.icosphere(3)
    vertices, _, normals, _ = shade(sphere)
    assert len(vertices) == len(sphere.vertices)
    # Area-weighted normals of an icosphere's vertices are off by less than an edge's square.
    assert_allclose(normals, vertices, atol=0.16**2)


def test_arrows_point_along_normals() -> None:
    directions = np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8]]])
    poses = _poses_along(np.zeros((7, 3)), directions)
    assert_allclose(poses[:, :3, 2], directions)
    assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)
    identity = np.broadcast_to(np.eye(3), (7, 3, 3))
    assert_allclose(poses[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2), identity, atol=1e-12)


def test_contacts_are_drawn_where_they_are() -> None:
    page = Scene(contacts=_contacts()).html()
    [ball] = [c for c in _commands(page) if c["path"].endswith("contacts/ball")]
    matrices = ball["object"]["object"]["instanceMatrix"]["array"]
    at = np.frombuffer(matrices.data, np.float32).reshape(-1, 4, 4).swapaxes(1, 2)
    assert_allclose(at[:, :3, 3], _contacts().points, atol=1e-8)
    assert_allclose(at[:, :3, 2], _contacts().normals, atol=1e-7)


def test_colours_of_vertices_are_those_of_their_uncertainty() -> None:
    mesh = _estimate()
    [drawn] = [c for c in _commands(_scene().html()) if c["path"].endswith("object/estimate")]
    attributes = drawn["object"]["geometries"][0]["data"]["attributes"]
    position, colour = (
        np.frombuffer(attributes[name]["array"].data, np.float32).reshape(-1, 3)
        for name in ("position", "color")
    )
    uncertainty = 1e-3 * (1.0 + position[:, 2] / HALF)
    scale = ColourScale.of(mesh.vertex_attributes["uncertainty"])
    assert_allclose(colour, linear_rgb(scale.colours(uncertainty)), atol=1e-5)


def test_names_within_a_command_do_not_depend_on_time_or_machine() -> None:
    first, second = (draw_mesh("a", _box(), material()) for _ in range(2))
    assert first == second
    assert umsgpack.unpackb(first)["object"]["object"]["uuid"].startswith("00000000-")


def test_animation_passes_through_every_pose() -> None:
    motion = _motion()
    command = umsgpack.unpackb(animate(motion.times, [("box", motion.poses["object"])]))
    [clip] = command["animations"]
    keys = {track["name"]: track["keys"] for track in clip["clip"]["tracks"]}
    assert clip["path"] == "/box"
    assert clip["clip"]["fps"] == 1
    times = [key["time"] for key in keys[".position"]]
    heights = [key["value"][2] for key in keys[".position"]]
    assert len(times) < 10  # straight stretches keep their ends only
    played = np.interp(motion.times, times, heights)
    assert_allclose(played, motion.poses["object"][:, 2, 3], atol=1e-7)  # single precision
    assert_allclose([key["value"] for key in keys[".quaternion"]], [[0, 0, 0, 1]] * 2)


def test_animation_of_the_page_is_at_rest_until_it_is_played() -> None:
    [command] = [c for c in _commands(_scene().html()) if c["type"] == "set_animation"]
    assert command["options"]["play"] is False
    paths = [clip["path"] for clip in command["animations"]]
    assert paths == ["/lis_grasp/object", *(f"/lis_grasp/hand/{k}" for k in range(3))]


def test_points_lie_on_the_surface_and_on_every_face() -> None:
    points = surface_points(_box(), 200)
    assert len(points) >= 200
    assert_allclose(np.abs(points).max(axis=1), HALF)
    assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)


def test_outermost_points_span_the_same_box() -> None:
    points = np.vstack([box_corners(surface_points(_box())), np.zeros((50, 3))])
    kept = outermost(points)
    assert len(kept) == 8
    assert_allclose(box_corners(kept), box_corners(points))


def test_camera_looks_past_the_obstacle() -> None:
    subject = surface_points(_box())
    wall = surface_points(trimesh.creation.box((0.01, 0.2, 0.2), _pose(0.08, 0, 0)))
    azimuth = choose_azimuth(subject, wall)
    assert np.cos(azimuth) < 0.0  # the wall stands at +x, so the camera at -x


# ---- the server -----------------------------------------------------------------------------


def _get(address: str) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(address, timeout=10) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def test_server_shows_the_scene_as_it_is_now_and_nothing_else(tmp_path: Path) -> None:
    scene = tmp_path / "scene.html"
    scene.write_text("first")
    (tmp_path / "secret.txt").write_text("secret")
    with SceneServer(tmp_path, port=0) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            assert server.server_address[0] == "127.0.0.1"
            assert _get(server.address) == (200, b"first")
            scene.write_text("second")
            assert _get(server.address + "scene.html?reload") == (200, b"second")
            for other in ("secret.txt", "../secret.txt", "..%2fscene.html", "x"):
                assert _get(server.address + other)[0] == 404
            scene.unlink()
            assert _get(server.address)[0] == 404
        finally:
            server.shutdown()
            thread.join()


def test_a_folder_without_a_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match=r"scene\.html does not exist"):
        SceneServer(tmp_path, port=0)


def test_a_port_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.html").touch()
    with SceneServer(tmp_path, port=0) as server:
        port = server.server_address[1]
        with pytest.raises(InvalidOptionError, match=f"port {port} cannot be used"):
            SceneServer(tmp_path, port=port)
    with pytest.raises(InvalidOptionError, match="0 to 65535"):
        SceneServer(tmp_path, port=65536)


# ---- in a browser ---------------------------------------------------------------------------

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


def _browse(page: Path, fragment: str, tmp_path: Path, *options: str) -> tuple[str, str]:
    """Open a page in a browser; return what it wrote to stdout, and what it complained of."""
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--enable-unsafe-swiftshader",
            "--use-angle=swiftshader",
            "--disable-background-networking",
            "--no-first-run",
            "--hide-scrollbars",
            "--enable-logging=stderr",
            f"--user-data-dir={tmp_path / 'profile'}",
            "--virtual-time-budget=2000",
            "--window-size=480,360",
            *options,
            f"{page.as_uri()}#{fragment}",
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    # A request that the page's policy refuses is reported on the console, as errors are.
    complaints = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout, "\n".join(complaints)


def _photograph(page: Path, fragment: str, tmp_path: Path) -> np.ndarray:
    """Return the picture (H, W, 3) in [0, 1] of a page in a browser without complaints."""
    from PIL import Image

    picture = tmp_path / "picture.png"
    _, complaints = _browse(page, fragment, tmp_path, f"--screenshot={picture}")
    assert not complaints
    with Image.open(io.BytesIO(picture.read_bytes())) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float64) / 255.0


def _share(picture: np.ndarray, hue: tuple[float, float], saturation: float = 0.35) -> float:
    """Return the share of pixels whose hue [deg] lies in an interval (through 360 if needed)."""
    high, low = picture.max(axis=2), picture.min(axis=2)
    chroma = np.maximum(high - low, 1e-12)
    r, g, b = np.moveaxis(picture, 2, 0)
    angle = np.select(
        [high == r, high == g], [(g - b) / chroma, 2.0 + (b - r) / chroma], 4.0 + (r - g) / chroma
    )
    turn = (60.0 * angle - hue[0]) % 360.0
    vivid = (high - low) > saturation * np.maximum(high, 1e-12)
    return float(np.mean(vivid & (turn <= (hue[1] - hue[0]) % 360.0)))


RED, BLUE, GREEN = (345.0, 15.0), (205.0, 225.0), (80.0, 175.0)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.html"
    path.write_text(_scene().html(), encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_layers_really_draw(page: Path, tmp_path: Path) -> None:
    pictures = {}
    for layers in ("", "estimate", "contacts", "truth", "estimate,contacts,truth,grasp-1"):
        fragment = f"panel=0&layers={layers}"
        pictures[layers] = _photograph(page, fragment, tmp_path)
    bare = pictures[""]
    for colour in (RED, BLUE, GREEN):
        assert _share(bare, colour) < 1e-4
    assert _share(pictures["estimate"], GREEN) > 0.05
    assert _share(pictures["estimate"], RED) < 1e-4
    assert _share(pictures["contacts"], RED) > 0.002
    assert _share(pictures["contacts"], GREEN) < 1e-4
    assert _share(pictures["truth"], BLUE) > 0.05
    everything = pictures["estimate,contacts,truth,grasp-1"]
    assert _share(everything, GREEN) > 0.01
    assert _share(everything, RED) > 2e-4
    dark = [float(np.mean(p.max(axis=2) < 0.35)) for p in (everything, bare)]
    assert dark[0] > dark[1] + 0.02  # the hand


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_lift_really_lifts(page: Path, tmp_path: Path) -> None:
    heights = []
    for time in (0.9, 2.0):
        picture = _photograph(page, f"panel=0&t={time}", tmp_path)
        assert _share(picture, GREEN) < 1e-3  # the estimate has made way for the object
        blue = picture[..., 2] - picture[..., 0] > 0.15
        assert blue.mean() > 0.01
        heights.append(np.argwhere(blue)[:, 0].mean() / len(picture))
    # The view is the same from 0.4 s on; 10 cm of about 30 cm in view is a third of the picture.
    assert heights[0] - heights[1] > 0.15


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_lift_really_plays(page: Path, tmp_path: Path) -> None:
    for fragment, plays in (("play=1", True), ("t=0", False)):
        document, complaints = _browse(page, fragment, tmp_path, "--dump-dom")
        assert not complaints
        clock = re.search(r"<output[^>]*>([\d.]+) / 2.00 s</output>", document)
        assert clock is not None
        assert (float(clock[1]) > 0.0) == plays
