"""Scene pages: layers, escaping, security policy, geometry, and the web server."""

from __future__ import annotations

import base64
import http.client
import io
import json
import os
import re
import socket
import sys
import urllib.error
import urllib.request
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import trimesh
import umsgpack
from numpy.testing import assert_allclose, assert_array_equal

from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.exploration import LoggedProbe, Observation, Probe, ProbeOutcome
from lis_grasp.exploration.planar_motion import PoseBelief, planar_pose
from lis_grasp.visualization import Scene, SceneServer
from lis_grasp.visualization._drawing import animate, draw_mesh, material, shade
from lis_grasp.visualization._object_layers import _poses_along, marker_size, motion_paths
from lis_grasp.visualization.camera import choose_azimuth, outermost, surface_points
from lis_grasp.visualization.colours import ColourScale, linear_rgb, round_up, viridis
from lis_grasp.world import Body, Surroundings


def _commands(page: str) -> list[dict[str, Any]]:
    facts = scenes.facts_of(page)
    file = io.BytesIO(zlib.decompress(base64.b64decode(facts["commands"])))
    return [umsgpack.unpackb(file.read(length)) for length in facts["lengths"]]


def _without_viewer(page: str) -> str:
    return page[: page.index("<script>")] + page[page.rindex("<script>") :]


# ---- the page -------------------------------------------------------------------------------


def test_page_draws_every_layer_it_offers() -> None:
    page = scenes.scene().html()
    offered = [layer["id"] for layer in scenes.facts_of(page)["layers"]]
    objects = ["estimate", "truth", "contacts", "normals", "free", "hand"]
    grasps = ["grasp-1", "grasp-2", "together"]
    assert offered == [*objects, *grasps, "lift"]
    assert re.findall(r'data-layer="([^"]+)"', page) == [*objects, "lift", *grasps]
    drawn = {c["path"] for c in _commands(page) if c["type"] == "set_object"}
    for path in ("object/estimate/3", "object/estimate/6", "object/truth", "object/contacts/ball",
                 "object/normals/head", "object/free", "hand/0/0", "hand/1/0", "hand/2/0",
                 "table", "grid"):  # fmt: skip
        assert f"/lis_grasp/{path}" in drawn


def test_fixed_and_free_bodies_are_layers_that_are_drawn_and_named() -> None:
    beside = Surroundings(
        (
            Body.of_mesh("crate", trimesh.creation.box()),
            Body.box("cup", (0.1, 0.1, 0.1), (1.0, 0.0, 0.0), mass=0.1),
        )
    )
    page = replace(scenes.scene(), surroundings=beside).html()
    layers = {layer["id"]: layer for layer in scenes.facts_of(page)["layers"]}
    assert (layers["surroundings"]["note"], layers["free-bodies"]["note"]) == ("crate", "cup")
    assert layers["surroundings"]["colour"] != layers["free-bodies"]["colour"]
    drawn = {command["path"] for command in _commands(page) if command["type"] == "set_object"}
    assert {"/lis_grasp/surroundings/0", "/lis_grasp/free-bodies/0"} <= drawn


def test_the_page_has_the_five_best_grasps() -> None:
    page = scenes.scene(grasps=(scenes.grasp(),) * 7).html()
    assert len(scenes.facts_of(page)["grasps"]) == 5


def test_the_page_counts_the_grasps_that_were_planned() -> None:
    for planned, listed in ((7, True), (5, False)):
        page = scenes.scene(grasps=(scenes.grasp(),) * planned).html()
        (grasps,) = (c for c in scenes.facts_of(page)["story"]["chapters"] if c["name"] == "grasp")
        assert (grasps["grasps"], grasps["planned"]) == (5, planned)
        assert (f"best 5 of {planned}" in page) == listed


def test_links_are_drawn_at_their_forward_kinematics() -> None:
    grasp = scenes.grasp()
    hand = scenes.hand()
    posture = scenes.facts_of(scenes.scene().html())["grasps"][0]
    expected = hand.forward_kinematics(grasp.X_OH, grasp.joint_positions)
    for matrix, link in zip(posture, hand.links, strict=True):
        # The page keeps seven decimals.
        assert_allclose(np.array(matrix).reshape(4, 4).T, expected[link], atol=1e-7)


def test_joints_are_matched_by_name() -> None:
    grasp = replace(scenes.grasp(), joint_positions=np.array([0.01, 0.02]))
    swapped = replace(
        grasp, joint_names=("right_joint", "left_joint"), joint_positions=np.array([0.02, 0.01])
    )
    first, second = (
        scenes.facts_of(scenes.scene(grasps=(g,)).html())["grasps"] for g in (grasp, swapped)
    )
    assert first == second


def test_page_refers_to_nothing_outside_itself() -> None:
    page = scenes.scene().html()
    own = re.sub(r'"[\w+/]{60,}=*"', '""', _without_viewer(page))  # drawing commands in base64
    assert len(own) < 60_000
    assert not re.search(r"""["'(=]\s*(?:https?:)?//""", own)
    assert not re.search(r"\b(?:src|href|action|data)\s*=", own)
    assert not re.search(r"\b(?:fetch|import|XMLHttpRequest|WebSocket|EventSource)\s*\(", own)
    assert "url(" not in own
    # The viewer's own text holds addresses only as names of XML dialects.
    assert set(re.findall(r"https?://[\w./]+", page)) <= {"http://www.w3.org/1999/xhtml"}


def test_page_forbids_itself_connections_and_foreign_scripts() -> None:
    page = scenes.scene().html()
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    rules = dict(rule.strip().split(" ", 1) for rule in policy[1].split(";"))
    assert rules["default-src"] == "'none'"
    assert "connect-src" not in rules
    assert re.fullmatch(r"('sha256-[\w+/]{43}=' ?){2}", rules["script-src"])


def test_text_is_escaped() -> None:
    evil = '</script><script>alert(1)</script>"&<b>'
    grasp = replace(scenes.grasp(), quality={evil: 1.0, "epsilon": 0.1})
    page = scenes.scene(title=evil, summary=(evil,), grasps=(grasp,)).html()
    assert "alert(1)</script>" not in page.replace("&lt;", "<x").replace("\\u003c", "<x")
    escaped = "&lt;/script&gt;&lt;script&gt;alert(1)&lt;/script&gt;&quot;&amp;&lt;b&gt;"
    assert page.count(escaped) == 4  # the page's title, the heading, the summary, the quality
    assert page.count("<script") == scenes.scene().html().count("<script")


def test_notebook_frame_holds_the_page() -> None:
    scene = Scene(contacts=scenes.contacts(), title='A "box"')
    frame = re.search(r'<iframe srcdoc="([^"]*)" title="A &quot;box&quot;"', scene._repr_html_())
    text = frame[1]
    for entity, character in (("&lt;", "<"), ("&gt;", ">"), ("&quot;", '"'), ("&#x27;", "'")):
        text = text.replace(entity, character)
    assert text.replace("&amp;", "&") == scene.html()


def test_a_saved_scene_is_its_page(tmp_path: Path) -> None:
    Scene(truth=scenes.box(), title="A box").save(tmp_path / "new" / "scene.html")
    page = (tmp_path / "new" / "scene.html").read_text(encoding="utf-8")
    assert page == Scene(truth=scenes.box(), title="A box").html()


@pytest.mark.parametrize("only", ["truth", "estimate", "contacts"])
def test_one_layer_alone_is_a_scene(only: str) -> None:
    content = {"truth": scenes.box(), "estimate": scenes.estimate(), "contacts": scenes.contacts()}
    page = Scene(**{only: content[only]}).html()
    assert scenes.facts_of(page)["layers"][0]["id"] == only
    assert ('id="player"' in page) == (only == "contacts")  # which come one after the other


def test_a_single_contact_is_a_scene() -> None:
    page = Scene(contacts=scenes.contacts().subset([0])).html()
    assert "<span>1 contact<" in page
    assert not re.search(r"NaN|Infinity", json.dumps(scenes.facts_of(page)["camera"]))


def test_nothing_to_show_is_refused() -> None:
    with pytest.raises(InvalidOptionError):
        Scene(contacts=Contacts.empty())


@pytest.mark.parametrize("of_hand", [{"grasps": (1,)}, {"motion": 1}, {"touches": (None,)}])
def test_grasps_and_motions_without_their_hand_are_refused(of_hand: dict[str, Any]) -> None:
    with pytest.raises(InvalidOptionError) as error:
        Scene(truth=scenes.box(), **of_hand)
    assert error.value.option == "hand"


def test_grasps_of_another_hand_are_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        scenes.scene(grasps=(replace(scenes.grasp(), hand="claw"),))
    assert (error.value.option, error.value.value) == ("hand", "pincers")


# ---- colours --------------------------------------------------------------------------------


def test_scale_runs_from_zero_to_the_next_round_millimetres() -> None:
    scale = ColourScale.of(np.linspace(0.0, 2.6e-3, 100))
    assert (scale.low, scale.high, scale.clipped) == (0.0, 3e-3, False)
    assert scale.tick_labels() == ["0", "0.75", "1.5", "2.25", "3 mm"]


def test_infinite_uncertainty_is_clipped_to_the_upper_end() -> None:
    values = np.append(np.full(99, 1e-3), np.inf)
    scale = ColourScale.of(values)
    assert scale.high == pytest.approx(1e-3)
    assert scale.clipped
    assert scale.tick_labels()[-1] == "≥ 1 mm"
    assert_allclose(scale.colours([np.inf, np.nan, 5.0]), viridis([1.0, 1.0, 1.0]))


def test_runs_on_one_object_have_one_scale() -> None:
    scales = [ColourScale.of_object(0.14, values) for values in ([0.0, 1e-4], [0.01, np.inf])]
    assert {(scale.low, scale.high) for scale in scales} == {(0.0, 4e-3)}  # 2.5 % is 3.5 mm
    assert [scale.clipped for scale in scales] == [False, True]
    assert ColourScale.of_object(0.28, [0.0]).high == pytest.approx(8e-3)


def test_markers_scale_with_the_object_and_not_with_its_length() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    assert marker_size(0.1 * corners, 0.01) == pytest.approx(0.1)
    bar = [0.3, 0.025, 0.025] * corners
    assert marker_size(bar, 0.01) == pytest.approx(np.sqrt(0.3 * 0.025))
    assert marker_size(2.0 * bar, 0.01) == pytest.approx(2.0 * marker_size(bar, 0.01))
    assert marker_size(0.0 * bar, 0.01) == 0.01


def test_a_surface_without_finite_uncertainty_has_no_colour_scale() -> None:
    mesh = scenes.estimate()
    mesh.vertex_attributes["uncertainty"] = np.full(len(mesh.vertices), np.inf)
    assert "Standard deviation of the estimate" in scenes.scene().html()
    assert "Standard deviation of the estimate" not in scenes.scene(estimate=mesh).html()


def test_a_scale_of_zero_length_is_refused() -> None:
    with pytest.raises(InvalidOptionError):
        ColourScale(1e-3, 1e-3)


def test_lightness_increases_along_the_map() -> None:
    weights = np.array([0.2126, 0.7152, 0.0722])  # luminance of linear sRGB
    assert np.all(np.diff(linear_rgb(viridis(np.linspace(0, 1, 200))) @ weights) > 0.0)


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, 1.0), (1.01, 2.0), (0.0021, 0.003), (9.1, 10.0), (70.0, 80.0)]
)
def test_rounding_up_stops_at_the_next_round_number(value: float, expected: float) -> None:
    assert round_up(value) == pytest.approx(expected, rel=1e-12)


# ---- geometry -------------------------------------------------------------------------------


def test_a_box_is_shaded_flat() -> None:
    vertices, faces, normals, source = shade(scenes.box())
    assert len(vertices) == 24  # three normals at each of eight corners
    assert_allclose(vertices, scenes.box().vertices[source])
    flat = np.repeat(scenes.box().face_normals, 3, axis=0)
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
    page = Scene(contacts=scenes.contacts()).html()
    [ball] = [c for c in _commands(page) if c["path"].endswith("contacts/ball")]
    matrices = ball["object"]["object"]["instanceMatrix"]["array"]
    at = np.frombuffer(matrices.data, np.float32).reshape(-1, 4, 4).swapaxes(1, 2)
    assert_allclose(at[:, :3, 3], scenes.contacts().points, atol=1e-8)
    assert_allclose(at[:, :3, 2], scenes.contacts().normals, atol=1e-7)


def test_colours_of_vertices_are_those_of_their_uncertainty() -> None:
    mesh = scenes.estimate()
    [drawn] = [
        c for c in _commands(scenes.scene().html()) if c["path"].endswith("object/estimate/6")
    ]
    attributes = drawn["object"]["geometries"][0]["data"]["attributes"]
    position, colour = (
        np.frombuffer(attributes[name]["array"].data, np.float32).reshape(-1, 3)
        for name in ("position", "color")
    )
    uncertainty = 1e-3 * (1.0 + position[:, 2] / scenes.HALF)
    scale = ColourScale.of_object(mesh.extents.max(), mesh.vertex_attributes["uncertainty"])
    assert_allclose(colour, linear_rgb(scale.colours(uncertainty)), atol=1e-5)


def test_names_within_a_command_do_not_depend_on_time_or_machine() -> None:
    first, second = (draw_mesh("a", scenes.box(), material()) for _ in range(2))
    assert first == second
    assert umsgpack.unpackb(first)["object"]["object"]["uuid"].startswith("00000000-")


def test_animation_passes_through_every_pose() -> None:
    motion = scenes.motion()
    command = umsgpack.unpackb(animate(motion.times, [("box", motion.poses["object"])]))
    [clip] = command["animations"]
    keys = {track["name"]: track["keys"] for track in clip["clip"]["tracks"]}
    assert clip["path"] == "/box"
    assert clip["clip"]["fps"] == 1
    times = [key["time"] for key in keys[".position"]]
    heights = [key["value"][2] for key in keys[".position"]]
    assert len(times) < 10  # keys on straight lines are dropped
    played = np.interp(motion.times, times, heights)
    assert_allclose(played, motion.poses["object"][:, 2, 3], atol=1e-7)  # single precision
    assert_allclose([key["value"] for key in keys[".quaternion"]], [[0, 0, 0, 1]] * 2)


def test_animation_of_the_page_is_at_rest_until_it_is_played() -> None:
    [command] = [c for c in _commands(scenes.scene().html()) if c["type"] == "set_animation"]
    assert command["options"]["play"] is False
    paths = [clip["path"] for clip in command["animations"]]
    assert paths == ["/lis_grasp/object", *(f"/lis_grasp/hand/{k}" for k in range(3))]


def test_points_lie_on_the_surface_and_on_every_face() -> None:
    points = surface_points(scenes.box(), 200)
    assert len(points) >= 200
    assert_allclose(np.abs(points).max(axis=1), scenes.HALF)
    assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)


def test_outermost_points_span_the_same_box() -> None:
    corners = scenes.box().vertices
    kept = outermost(np.vstack([corners, np.zeros((50, 3))]))
    assert len(kept) == 8
    assert_array_equal(np.sort(kept, axis=0), np.sort(corners, axis=0))


def test_camera_looks_past_the_obstacle() -> None:
    subject = surface_points(scenes.box())
    wall = surface_points(trimesh.creation.box((0.01, 0.2, 0.2), scenes.pose(0.08, 0, 0)))
    azimuth = choose_azimuth(subject, wall)
    assert np.cos(azimuth) < 0.0  # the wall is at +x, so the camera is at -x


def test_camera_looks_at_the_broad_side_of_what_nothing_hides() -> None:
    bar = surface_points(trimesh.creation.box((0.02, 0.2, 0.02)))
    assert abs(np.cos(choose_azimuth(bar, np.empty((0, 3))))) > 0.8


# ---- the server -----------------------------------------------------------------------------


def _get(address: str) -> tuple[int, bytes]:
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # of this machine
    try:
        with direct.open(address, timeout=10) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()


def test_server_shows_the_scene_as_it_is_now_and_nothing_else(tmp_path: Path) -> None:
    scene = tmp_path / "scene.html"
    scene.write_text("first")
    (tmp_path / "secret.txt").write_text("secret")
    with scenes.served(tmp_path) as server:
        assert server.server_address[0] == "127.0.0.1"
        assert _get(server.address) == (200, b"first")
        scene.write_text("second")
        assert _get(server.address + "scene.html?reload") == (200, b"second")
        for other in ("secret.txt", "../secret.txt", "..%2fscene.html", "x"):
            assert _get(server.address + other)[0] == 404
        scene.unlink()
        assert _get(server.address)[0] == 404


def test_server_that_follows_says_when_the_scene_changes(tmp_path: Path) -> None:
    scene = tmp_path / "scene.html"
    with scenes.served(tmp_path, follow=True) as server:
        assert b"fetch(" in _get(server.address)[1]  # the page that asks again and again
        assert _get(server.address + "state") == (200, b"")
        assert _get(server.address + "scene.html")[0] == 404
        states = set()
        for time, text in ((1000, b"first"), (1001, b"second")):
            scene.write_bytes(text)
            os.utime(scene, (time, time))  # two writes of one tick of the clock have the same
            states.add(_get(server.address + "state"))
            assert _get(server.address + "scene.html") == (200, text)
        assert len(states) == 2


def test_server_answers_to_names_of_this_machine_only(tmp_path: Path) -> None:
    (tmp_path / "scene.html").write_text("mine")
    renewed = []
    with scenes.served(tmp_path, renew=lambda: renewed.append(1)) as server:
        for host, code in (
            ("localhost:8000", 200),  # forwarded by ssh
            ("127.0.0.1", 200),
            ("LOCALHOST", 200),
            ("evil.example", 403),
            ("localhost.evil.example:7000", 403),
            ("127.0.0.1.nip.example", 403),
            ("", 403),
            ("[::1", 403),
        ):
            connection = http.client.HTTPConnection(*server.server_address[:2], timeout=10)
            connection.request("GET", "/", headers={"Host": host})
            answer = connection.getresponse()
            assert (answer.status, b"mine" in answer.read()) == (code, code == 200)
            connection.close()
    assert len(renewed) == 3


@pytest.mark.skipif(sys.platform != "linux", reason="needs 127.0.0.2, which Linux has by itself")
def test_a_server_of_another_address_answers_to_its_name(tmp_path: Path) -> None:
    (tmp_path / "scene.html").write_text("mine")
    with scenes.served(tmp_path, host="127.0.0.2") as server:
        assert server.address == f"http://127.0.0.2:{server.server_address[1]}/"
        assert _get(server.address) == (200, b"mine")
    with SceneServer(tmp_path, port=0, host="0.0.0.0") as server:
        assert server.address.startswith("http://127.0.0.1:")


@pytest.mark.skipif(sys.platform != "linux", reason="needs 127.0.0.2, which Linux has by itself")
def test_server_listens_on_localhost_only(tmp_path: Path) -> None:
    (tmp_path / "scene.html").touch()
    with SceneServer(tmp_path, port=0) as server:
        port = server.server_address[1]
        with socket.create_connection(("127.0.0.1", port), timeout=5):
            pass
        # A server on all addresses, 0.0.0.0, would answer here too.
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", port), timeout=5)


def test_view_serves_the_folder_on_localhost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes.contacts().save(tmp_path / "contacts.ply")
    bound = []

    def serve(self: SceneServer, poll_interval: float = 0.5) -> None:
        bound.append(self.socket.getsockname()[0])
        raise KeyboardInterrupt

    monkeypatch.setattr(SceneServer, "serve_forever", serve)
    assert main(["view", str(tmp_path), "--port", "0"]) == 0
    assert bound == ["127.0.0.1"]
    assert "http://127.0.0.1:" in capsys.readouterr().err
    assert "6 contacts" in (tmp_path / "scene.html").read_text(encoding="utf-8")


def test_a_folder_without_a_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError) as error:
        SceneServer(tmp_path, port=0)
    assert error.value.path == tmp_path / "scene.html"


def test_a_port_in_use_or_out_of_range_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.html").touch()
    with SceneServer(tmp_path, port=0) as server:
        port = server.server_address[1]
        for wrong in (port, 65536):
            with pytest.raises(InvalidOptionError) as error:
                SceneServer(tmp_path, port=wrong)
            assert (error.value.option, error.value.value) == ("port", wrong)


def test_a_host_that_is_no_address_of_this_machine_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.html").touch()
    with pytest.raises(InvalidOptionError) as error:
        SceneServer(tmp_path, port=0, host="192.0.2.1")  # of the block for examples (RFC 5737)
    assert (error.value.option, error.value.value) == ("host", "192.0.2.1")


CENTER = np.array([0.1, 0.05, 0.02])


def _probes(tracked: list[np.ndarray], true: list[np.ndarray]) -> list[LoggedProbe]:
    """Return logged probes of an object at poses in W, tracked and true."""
    probe = Probe(np.zeros(3), np.array([0.0, 0.0, -1.0]), standoff=0.05, overshoot=0.01)
    return [
        LoggedProbe(
            Observation(ProbeOutcome(probe, "missed"), replace(PoseBelief.start(), X_WE=X_WE)),
            np.linalg.inv(X_WE) @ X_WO,
        )
        for X_WE, X_WO in zip(tracked, true, strict=True)
    ]


def test_a_perfect_tracker_draws_the_true_path() -> None:
    poses = [planar_pose(np.array([0.01 * k, 0.0, 0.1 * k])) for k in range(4)]
    tracked, true = motion_paths(_probes(poses, poses), CENTER)
    np.testing.assert_allclose(tracked, true, atol=1e-12)
    np.testing.assert_allclose(true[-1], CENTER, atol=1e-12)
    # Distances are those between the true places of the point.
    places = np.array([(pose @ np.append(CENTER, 1.0))[:3] for pose in poses])
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(true, axis=0), axis=1),
        np.linalg.norm(np.diff(places, axis=0), axis=1),
    )


def test_a_tracker_that_notices_nothing_stays_while_the_object_moves() -> None:
    poses = [planar_pose(np.array([0.002 * k, 0.0, 0.0])) for k in range(4)]
    tracked, true = motion_paths(_probes([np.eye(4)] * 4, poses), CENTER)
    np.testing.assert_allclose(tracked, np.tile(CENTER, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(true[:, 0] - true[0, 0], [0.0, 0.002, 0.004, 0.006], atol=1e-12)


def test_a_fixed_object_has_no_path() -> None:
    tracked, true = motion_paths((), CENTER)
    assert tracked.shape == true.shape == (0, 3)
