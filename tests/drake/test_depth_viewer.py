"""Depth images of Drake as views: pixel centres, masks by labels, and a real sensor."""

import subprocess
import sys

import numpy as np
import pytest
import trimesh
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.perception import DepthImageToPointCloud, PointCloud
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageLabel16I, PixelType

from lis_grasp.drake import DepthViewer
from lis_grasp.exceptions import InvalidViewError
from lis_grasp.views import DepthView, Intrinsics, look_at, render_depth
from lis_grasp.views.rendering import plane_depth

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
BOX = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.0, 0.0, 0.025])
X_WC = look_at([0.35, 0.2, 0.4], [0.0, 0.0, 0.02])

# Renders a table with Drake's own sensor; in a process of its own, because drivers may crash it.
_RENDER = """
import sys
import numpy as np
from pydrake.geometry import Box, MakeRenderEngineVtk, RenderEngineVtkParams
from pydrake.geometry import ClippingRange, ColorRenderCamera, DepthRange, DepthRenderCamera
from pydrake.geometry import GeometryInstance, MakePhongIllustrationProperties, RenderCameraCore
from pydrake.geometry import PerceptionProperties, RenderLabel, SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

width, height, focal = {size}
builder = DiagramBuilder()
graph = builder.AddSystem(SceneGraph())
graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
source = graph.RegisterSource("world")
table = GeometryInstance(RigidTransform([0, 0, -0.05]), Box(4, 4, 0.1), "table")
properties = PerceptionProperties()
properties.AddProperty("label", "id", RenderLabel(1))
table.set_perception_properties(properties)
graph.RegisterAnchoredGeometry(source, table)
info = CameraInfo(width, height, focal, focal, width / 2, height / 2)
core = RenderCameraCore("vtk", info, ClippingRange(0.01, 10.0), RigidTransform())
camera = DepthRenderCamera(core, DepthRange(0.1, 5.0))
X = np.array({pose})
sensor = builder.AddSystem(RgbdSensor(graph.world_frame_id(), RigidTransform(X), camera))
builder.Connect(graph.get_query_output_port(), sensor.query_object_input_port())
diagram = builder.Build()
context = sensor.GetMyContextFromRoot(diagram.CreateDefaultContext())
root = diagram.CreateDefaultContext()
image = sensor.depth_image_32F_output_port().Eval(sensor.GetMyContextFromRoot(root))
np.save(sys.argv[1], image.data[..., 0])
"""


def _drake_depth(with_box: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return depth and label as an `RgbdSensor` renders them: pixel centres at 0.5."""
    camera = Intrinsics(FOCAL, FOCAL, 0.5 * WIDTH - 0.5, 0.5 * HEIGHT - 0.5)
    shape = (HEIGHT, WIDTH)
    solids = [BOX] if with_box else []
    depth, label = render_depth(solids, camera, shape, X_WC)
    table = plane_depth(camera, shape, X_WC, 0.0)
    return np.minimum(depth, table), np.where(table < depth, -1, label)


def _image(kind: type, values: np.ndarray) -> object:
    image = kind(WIDTH, HEIGHT)
    image.mutable_data[..., 0] = values
    return image


def _view(viewer: DepthViewer, depth: np.ndarray, label: np.ndarray | None = None) -> DepthView:
    context = viewer.CreateDefaultContext()
    viewer.depth_image.FixValue(context, _image(ImageDepth32F, depth))
    viewer.camera_pose.FixValue(context, RigidTransform(X_WC))
    if label is not None:
        viewer.label_image.FixValue(context, _image(ImageLabel16I, label))
    return viewer.view.Eval(context)


def _info() -> CameraInfo:
    return CameraInfo(WIDTH, HEIGHT, FOCAL, FOCAL, 0.5 * WIDTH, 0.5 * HEIGHT)


def test_the_table_of_a_drake_image_is_at_its_height() -> None:
    depth, _ = _drake_depth()
    view = _view(DepthViewer(_info()), depth)
    table = np.isfinite(view.depth) & ~view.object_mask
    points = view.X_WC[:3, 3] + (
        view.depth[..., None] * view.intrinsics.rays(view.depth.shape) @ view.X_WC[:3, :3].T
    )
    far = np.linalg.norm(points[..., :2], axis=-1) > 0.07  # not of the box
    # Depths are in single precision: 4e-8 m.
    assert np.abs(points[table & far][:, 2]).max() < 1e-5


def test_the_contacts_of_a_drake_image_are_on_the_object() -> None:
    view = _view(DepthViewer(_info()), _drake_depth()[0])
    outside = np.abs(view.contacts.points - [0.0, 0.0, 0.025]) - [0.05, 0.03, 0.025]
    assert len(view.contacts) > 200
    assert np.median(np.abs(outside.max(axis=1))) < 1e-5


def test_the_cloud_of_an_image_is_the_same_view() -> None:
    depth, _ = _drake_depth()
    converter = DepthImageToPointCloud(_info(), PixelType.kDepth32F)
    context = converter.CreateDefaultContext()
    converter.depth_image_input_port().FixValue(context, _image(ImageDepth32F, depth))
    cloud = converter.point_cloud_output_port().Eval(context)
    viewer = DepthViewer(_info())
    context = viewer.CreateDefaultContext()
    viewer.point_cloud.FixValue(context, AbstractValue.Make(cloud))
    viewer.camera_pose.FixValue(context, RigidTransform(X_WC))
    view, same = viewer.view.Eval(context), _view(viewer, depth)
    known = np.isfinite(same.depth)
    assert np.abs(view.depth - same.depth)[known].max() < 1e-6
    assert np.array_equal(view.object_mask, same.object_mask)
    few = PointCloud(10)
    viewer.point_cloud.FixValue(context, AbstractValue.Make(few))
    with pytest.raises(InvalidViewError) as caught:
        viewer.view.Eval(context)
    assert caught.value.field == "points"


def test_labels_are_the_mask() -> None:
    depth, label = _drake_depth()
    view = _view(DepthViewer(_info(), label=7), depth, np.where(label == 0, 7, 3))
    assert np.array_equal(view.object_mask, label == 0)


def test_a_label_image_needs_a_label() -> None:
    depth, label = _drake_depth()
    with pytest.raises(InvalidViewError) as caught:
        _view(DepthViewer(_info()), depth, np.where(label == 0, 7, 3))
    assert caught.value.field == "mask"


def test_a_rendered_table_is_at_its_height(tmp_path) -> None:
    """Drake's own sensor, where the machine can render; its driver may crash a process."""
    size, pose = (WIDTH, HEIGHT, FOCAL), X_WC.tolist()
    program = _RENDER.replace("{size}", str(size)).replace("{pose}", str(pose))
    path = tmp_path / "depth.npy"
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, timeout=120
    )
    if done.returncode and ("EGL" in done.stderr or done.returncode < 0):
        pytest.skip("Drake cannot render here: no EGL")
    assert done.returncode == 0, done.stderr
    depth, exact = np.load(path).astype(np.float64), _drake_depth(with_box=False)[0]
    near = exact < 1.5  # far from the end of the table
    assert np.abs(depth - exact)[near].max() < 1e-5
