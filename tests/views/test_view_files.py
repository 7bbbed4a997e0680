"""Files of depth views: images with a camera's YAML, archives, and mistakes in them."""

from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from camera_recording import write_camera_bag
from PIL import Image
from scipy.spatial.transform import Rotation

from lis_grasp import Contacts
from lis_grasp.cli.main import main
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidInputError,
    InvalidViewError,
    NothingSeenError,
)
from lis_grasp.logs.depth_images import load_bag_view
from lis_grasp.results.seen import see
from lis_grasp.views import (
    DepthCamera,
    DepthView,
    Intrinsics,
    draw_camera_pose,
    load_view,
    save_view,
    simulate_view,
)
from lis_grasp.views.image_files import load_image
from lis_grasp.views.organised_clouds import depth_of_points

BOX = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.0, 0.0, 0.025])
K = {"fx": 385.0, "fy": 385.0, "cx": 319.5, "cy": 239.5}


@pytest.fixture(scope="module")
def view() -> DepthView:
    rng = np.random.default_rng(0)
    return simulate_view([BOX], draw_camera_pose([0.0, 0.0, 0.03], rng=rng), rng=rng)


def _write(folder: Path, view: DepthView, **changes: Any) -> tuple[Path, Path]:
    """Write a PNG in millimetres and the YAML of its camera, with changes of the YAML."""
    depth = np.where(np.isfinite(view.depth), 1e3 * view.depth, 0.0)
    Image.fromarray(np.rint(depth).astype(np.uint16)).save(folder / "depth.png")
    facts = {"intrinsics": K, "pose": view.X_WC.tolist(), "depth_unit": "mm"} | changes
    facts = {name: value for name, value in facts.items() if value is not None}
    (folder / "camera.yaml").write_text(yaml.safe_dump(facts), encoding="utf-8")
    return folder / "depth.png", folder / "camera.yaml"


def test_a_png_has_its_depths_in_millimetres(view: DepthView, tmp_path: Path) -> None:
    read = load_image(*_write(tmp_path, view))
    known = np.isfinite(view.depth)
    assert np.array_equal(np.isfinite(read.depth), known)
    assert np.abs(read.depth - view.depth)[known].max() <= 0.5e-3 + 1e-9
    assert read.intrinsics == view.intrinsics


def test_an_array_and_a_matrix_are_read_exactly(view: DepthView, tmp_path: Path) -> None:
    matrix = [[385.0, 0.0, 320.0], [0.0, 385.0, 240.0], [0.0, 0.0, 1.0]]
    changes = {"intrinsics": None, "K": matrix, "pixel_center": 0.5, "depth_unit": None}
    _, camera = _write(tmp_path, view, **changes)
    np.save(tmp_path / "depth.npy", view.depth)
    read = load_image(tmp_path / "depth.npy", camera)
    assert np.array_equal(read.depth, view.depth, equal_nan=True)
    assert read.intrinsics == view.intrinsics


def test_the_nine_numbers_of_ros_are_the_three_rows(view: DepthView, tmp_path: Path) -> None:
    matrix = np.array([[385.0, 0.0, 319.5], [0.0, 385.0, 239.5], [0.0, 0.0, 1.0]])
    for given in (matrix.tolist(), matrix.ravel().tolist()):
        read = load_image(*_write(tmp_path, view, intrinsics=None, K=given))
        assert read.intrinsics == view.intrinsics


@pytest.mark.parametrize("name", [*K, "position", "rotation_degrees"])
def test_a_key_outside_its_mapping_or_missing_in_it_is_answered(
    name: str, view: DepthView, tmp_path: Path
) -> None:
    outer = "intrinsics" if name in K else "hand_eye"
    with pytest.raises(InvalidFileError, match=f"unknown key {name}: it belongs to {outer}$"):
        load_image(*_write(tmp_path, view, **{name: 1.0}))
    whole = K if name in K else {"position": 0.0, "rotation_degrees": 0.0}
    rest = {key: value for key, value in whole.items() if key != name}
    with pytest.raises(InvalidFileError, match=f"{outer} must have .*; it lacks {name}$"):
        load_image(*_write(tmp_path, view, **{outer: rest}))


def test_a_pose_that_is_not_there_is_called_missing(view: DepthView, tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="pose must be 4 x 4 finite numbers; it is missing"):
        load_image(*_write(tmp_path, view, pose=None))


def test_an_archive_keeps_every_bit(view: DepthView, tmp_path: Path) -> None:
    save_view(view, tmp_path / "view.npz")
    assert load_view(tmp_path / "view.npz") == view


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"depth_unit": "m"}, "depth_unit"),  # millimetres taken for metres
        ({"depth_unit": "inch"}, "depth_unit"),
        ({"pose": np.eye(4)[:3].tolist()}, "pose"),
        ({"pose": (2.0 * np.eye(4)).tolist()}, "pose"),
        ({"intrinsics": {"fx": 385.0}}, "intrinsics"),
        ({"intrinsics": K | {"cx": 900.0}}, "intrinsics"),
        ({"intrinsics": None, "K": [[385, 0, 0], [0, 385, 0], [319, 239, 1]]}, "K"),
        ({"pixel_center": 0.3}, "pixel_center"),
        ({"focal": 3}, "focal"),
        ({"mask": 5}, "mask"),
        ({"hand_eye": {"position": 0.002}}, "hand_eye"),
    ],
)
def test_a_mistake_in_a_camera_file_is_named(
    view: DepthView, tmp_path: Path, changes: dict[str, Any], field: str
) -> None:
    with pytest.raises(InvalidFileError) as caught:
        load_image(*_write(tmp_path, view, **changes))
    assert caught.value.field == field
    assert caught.value.path == tmp_path / "camera.yaml"


def test_a_mask_of_another_shape_is_refused(view: DepthView, tmp_path: Path) -> None:
    Image.fromarray(np.full((10, 20), 255, dtype=np.uint8)).save(tmp_path / "mask.png")
    with pytest.raises(InvalidFileError) as caught:
        load_image(*_write(tmp_path, view, mask="mask.png"))
    assert caught.value.field == "mask"


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n"])
def test_a_damaged_image_is_refused(content: bytes, view: DepthView, tmp_path: Path) -> None:
    image, camera = _write(tmp_path, view)
    image.write_bytes(content)
    with pytest.raises(InvalidFileError) as caught:
        load_image(image, camera)
    assert caught.value.path == image


def test_see_writes_the_view_its_contacts_and_a_page(
    view: DepthView, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, camera = _write(tmp_path, view)
    output = tmp_path / "out"
    assert main(["see", str(image), "--camera", str(camera), "--output", str(output)]) == 0
    contacts = Contacts.load(output / "contacts.ply")
    assert 300 <= len(contacts) <= 400
    # A step of the image is 1 mm: 0.3 mm root mean square beside the camera's noise of 0.5 mm.
    distances = trimesh.proximity.closest_point(BOX, contacts.points)[1]
    assert np.median(distances) < 1e-3
    found, true = load_view(output / "view.npz").object_mask, view.object_mask
    assert np.count_nonzero(found & true) > 0.85 * np.count_nonzero(found | true)
    assert "data:image/png;base64" in (output / "seen.html").read_text(encoding="utf-8")
    said = capsys.readouterr().out
    assert f"{np.count_nonzero(found)} pixels" in said


def test_see_says_that_nothing_stands_on_the_table(
    view: DepthView, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far = BOX.copy().apply_translation([0.0, 0.0, -1.0])
    empty = simulate_view([far], view.X_WC, rng=np.random.default_rng(0))
    image, camera = _write(tmp_path, empty)
    assert main(["see", str(image), "--camera", str(camera)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "view.npz").exists()


def test_an_object_without_any_depth_is_named(view: DepthView, tmp_path: Path) -> None:
    holes = np.where(view.object_mask, np.nan, view.depth)
    with pytest.raises(NothingSeenError):
        see(replace(view, depth=holes), 0.0, tmp_path / "seen")
    assert not (tmp_path / "seen").exists()


def _write_pcd(path: Path, view: DepthView, data: str, viewpoint: str = "") -> Path:
    """Write the view as an organised cloud in the frame of its camera."""
    height, width = view.depth.shape
    points = view.depth[..., None] * view.intrinsics.rays(view.depth.shape)
    points[~np.isfinite(view.depth)] = np.nan
    rows = points.reshape(-1, 3).astype("<f4")
    body = rows.tobytes()
    if data == "ascii":
        body = "\n".join(" ".join(f"{x:.9g}" for x in row) for row in rows).encode()
    elif data == "binary_compressed":
        plain = rows.T.tobytes()  # field by field; literal runs of LZF
        runs = (plain[at : at + 32] for at in range(0, len(plain), 32))
        packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
        body = np.array([len(packed), len(plain)], "<u4").tobytes() + packed
    head = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {width}\n"
        f"HEIGHT {height}\n{viewpoint}POINTS {width * height}\nDATA {data}\n"
    )
    path.write_bytes(head.encode() + body)
    return path


@pytest.fixture(scope="module")
def small() -> DepthView:
    camera = DepthCamera(Intrinsics(90.0, 88.0, 79.0, 61.0), (120, 160))
    X_WC = draw_camera_pose([0.0, 0.0, 0.03], rng=np.random.default_rng(1))
    return simulate_view([BOX], X_WC, camera, rng=np.random.default_rng(1))


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_an_organised_cloud_has_its_camera(data: str, small: DepthView, tmp_path: Path) -> None:
    x, y, z, w = Rotation.from_matrix(small.X_WC[:3, :3]).as_quat()
    seven = " ".join(map(str, (*small.X_WC[:3, 3], w, x, y, z)))
    read = load_image(_write_pcd(tmp_path / "a.pcd", small, data, f"VIEWPOINT {seven}\n"))
    known = np.isfinite(small.depth)
    assert np.array_equal(np.isfinite(read.depth), known)
    assert np.abs(read.depth - small.depth)[known].max() < 1e-6  # single precision
    assert np.allclose(read.X_WC, small.X_WC, atol=1e-12)
    found, true = (astuple(each.intrinsics) for each in (read, small))
    assert np.abs(np.subtract(found, true)).max() < 1e-3


def test_a_cloud_without_a_viewpoint_needs_the_pose(small: DepthView, tmp_path: Path) -> None:
    cloud = _write_pcd(tmp_path / "a.pcd", small, "binary", "VIEWPOINT 0 0 0 1 0 0 0\n")
    with pytest.raises(InvalidFileError) as caught:
        load_image(cloud)
    assert caught.value.field == "pose"
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump({"pose": small.X_WC.tolist()}))
    assert np.array_equal(load_image(cloud, tmp_path / "camera.yaml").X_WC, small.X_WC)


def test_points_that_are_not_of_a_camera_are_refused(small: DepthView) -> None:
    points = small.depth[..., None] * small.intrinsics.rays(small.depth.shape)
    turned = points * [1.0, -1.0, -1.0]  # z backward, as in OpenGL
    depth, _, X_SC = depth_of_points(turned)
    assert np.array_equal(np.isfinite(depth), np.isfinite(small.depth))
    assert np.allclose(X_SC[:3, :3] @ [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    for wrong in (points @ small.X_WC[:3, :3].T + small.X_WC[:3, 3], -points, points[0]):
        with pytest.raises(InvalidViewError) as caught:
            depth_of_points(wrong)
        assert caught.value.field == "points"


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_a_bag_has_the_depth_the_camera_and_its_pose(
    encoding: str, small: DepthView, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags")
    bag = write_camera_bag(tmp_path / "bag", small, encoding)
    (tmp_path / "camera.yaml").write_text("frame: table\nhand_eye: [0.002, 0.5]\n")
    read = load_bag_view(bag, tmp_path / "camera.yaml")
    known = np.isfinite(small.depth)
    step = 0.5e-3 if encoding == "16UC1" else 1e-6  # half a millimetre, or single precision
    assert np.abs(read.depth - small.depth)[known].max() <= step + 1e-9
    assert np.array_equal(np.isfinite(read.depth), known)
    assert read.intrinsics == small.intrinsics
    assert np.allclose(read.X_WC, small.X_WC, atol=1e-12)
    assert read.hand_eye.position == 0.002


def test_a_bag_without_depth_is_refused(small: DepthView, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    bag = write_camera_bag(tmp_path / "bag", small, "rgb8")
    (tmp_path / "camera.yaml").write_text("frame: table\n")
    with pytest.raises(InvalidInputError):
        load_bag_view(bag, tmp_path / "camera.yaml")
