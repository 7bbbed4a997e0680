"""Outlines: exact silhouettes, bounds, and files read back by other readers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely
import trimesh

from lis_grasp import outline
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.exports.outline import PROBABILITIES, Outline, needed, scales
from lis_grasp.exports.outline_files import save_outline
from lis_grasp.io.provenance import describe
from lis_grasp.io.surface_files import save_surface
from lis_grasp.shapes import resting_poses

SIDES = (0.06, 0.04, 0.02)
L_CORNERS = [(0.0, 0.0), (0.06, 0.0), (0.06, 0.02), (0.02, 0.02), (0.02, 0.05), (0.0, 0.05)]


def uncertain(mesh: trimesh.Trimesh, deviation: float) -> trimesh.Trimesh:
    """Return a mesh with the same standard deviation everywhere [m]."""
    mesh.vertex_attributes["uncertainty"] = np.full(len(mesh.vertices), deviation)
    return mesh


def with_hole() -> trimesh.Trimesh:
    """Return a plate of 60 mm with a square hole of 20 mm through it."""
    ring = shapely.box(-0.03, -0.03, 0.03, 0.03) - shapely.box(-0.01, -0.01, 0.01, 0.01)
    return trimesh.creation.extrude_polygon(ring, 0.01, engine="manifold")


@pytest.mark.parametrize(("axis", "first", "second"), [("z", 0, 1), ("x", 1, 2), ("y", 2, 0)])
def test_a_box_has_its_faces_as_outlines(axis: str, first: int, second: int) -> None:
    found = outline(trimesh.creation.box(SIDES), axis)
    assert found.polygon.bounds == pytest.approx(
        0.5 * np.array([-SIDES[first], -SIDES[second], SIDES[first], SIDES[second]])
    )
    assert found.polygon.area == pytest.approx(SIDES[first] * SIDES[second])
    assert np.allclose(found.rotation @ np.roll([0.0, 0.0, 1.0], 1 + "xyz".index(axis)), [0, 0, 1])


def test_a_vector_and_an_axis_see_the_same_shape() -> None:
    """Along (1, 1, 1) a cube's shadow is a regular hexagon, of area sqrt(3) a^2."""
    cube = trimesh.creation.box([0.05] * 3)
    assert outline(cube, [1.0, 1.0, 1.0]).polygon.area == pytest.approx(np.sqrt(3.0) * 0.05**2)
    assert outline(cube, [0.0, 0.0, 2.0]).polygon.area == pytest.approx(0.05**2)


def test_a_cylinder_has_a_disc_and_a_rectangle() -> None:
    """The disc is a regular polygon of n sides: n / 2 sin(2 pi / n) r^2."""
    cylinder = trimesh.creation.cylinder(radius=0.02, height=0.07, sections=64)
    polygon_area = 32.0 * np.sin(2.0 * np.pi / 64) * 0.02**2
    assert outline(cylinder).polygon.area == pytest.approx(polygon_area, rel=1e-4)
    assert outline(cylinder, "x").polygon.area == pytest.approx(0.04 * 0.07, rel=2e-3)


def test_a_profile_keeps_its_notch() -> None:
    profile = shapely.Polygon(L_CORNERS)
    # Vertices are float32 in trimesh's extrusion.
    solid = trimesh.creation.extrude_polygon(profile, 0.03, engine="manifold")
    assert outline(solid).polygon.symmetric_difference(profile).area < 1e-8


def test_a_hole_stays_a_hole_and_its_bounds_are_smaller_and_larger() -> None:
    found = outline(uncertain(with_hole(), 0.001))
    assert found.polygon.area == pytest.approx(0.06**2 - 0.02**2)
    assert not found.polygon.contains(shapely.Point(0.0, 0.0))
    (hole,) = found.outer.interiors
    assert shapely.Polygon(hole).area == pytest.approx((0.02 - 2.0 * found.clearance) ** 2)


@pytest.mark.parametrize("probability", [*PROBABILITIES, 0.7])
def test_bounds_are_offsets_by_the_mean_deviation(probability: float) -> None:
    """A square grown by c with round joins: a^2 + 4 a c + pi c^2; shrunk: (a - 2 d)^2."""
    side, deviation = 0.06, 0.001
    mesh = uncertain(trimesh.creation.box([side] * 3).subdivide().subdivide(), deviation)
    found = outline(mesh, clearance_for=probability)
    grow, shrink = scales(probability)
    assert found.clearance == pytest.approx(grow * deviation)
    grown = side**2 + 4.0 * side * found.clearance + np.pi * found.clearance**2
    assert found.outer.area == pytest.approx(grown, rel=1e-4)
    assert found.inner.area == pytest.approx((side - 2.0 * shrink * deviation) ** 2)
    assert found.outer.contains(found.polygon)
    assert found.polygon.contains(found.inner)


def test_clearances_grow_with_the_probability() -> None:
    values = np.array([scales(p) for p in PROBABILITIES])
    assert (np.diff(values, axis=0) > 0.0).all()


def test_a_wall_touched_at_one_height_is_known() -> None:
    """The silhouette takes the least deviation along the direction of view."""
    mesh = trimesh.creation.box(SIDES).subdivide_to_size(0.0015)
    below = mesh.vertices[:, 2] < 0.0
    mesh.vertex_attributes["uncertainty"] = np.where(below, 0.0005, 0.02)
    assert outline(mesh).clearance == pytest.approx(scales(0.9)[0] * 0.0005)


def test_an_exact_mesh_needs_no_clearance() -> None:
    found = outline(trimesh.creation.box(SIDES))
    assert found.clearance == 0.0
    assert found.outer.equals(found.polygon)


def test_needs_are_distances_between_outlines() -> None:
    small, large = shapely.box(-0.02, -0.02, 0.02, 0.02), shapely.box(-0.025, -0.02, 0.02, 0.02)
    assert needed(small, large) == pytest.approx((0.005, 0.0))
    assert needed(large, small) == pytest.approx((0.0, 0.005))


def test_a_resting_pose_is_seen_from_above() -> None:
    box = trimesh.creation.box(SIDES)
    areas = [outline(box, pose=n).polygon.area for n in range(len(resting_poses(box)))]
    assert areas[0] == pytest.approx(SIDES[0] * SIDES[1])  # on its largest face, the likeliest
    assert sorted(areas) == pytest.approx(
        sorted(2 * [SIDES[0] * SIDES[1], SIDES[0] * SIDES[2], SIDES[1] * SIDES[2]])
    )


@pytest.mark.parametrize(
    "options",
    [
        {"clearance_for": 0.99},
        {"clearance_for": 0.4},
        {"axis": "w"},
        {"axis": [0, 0, 0]},
        {"axis": [1, 2]},
        {"pose": 6},
        {"pose": -1},
    ],
)
def test_values_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(InvalidOptionError) as error:
        outline(trimesh.creation.box(SIDES), **options)  # type: ignore[arg-type]
    assert error.value.option in options


def test_an_open_mesh_is_refused() -> None:
    box = trimesh.creation.box(SIDES)
    with pytest.raises(InvalidMeshError):
        outline(trimesh.Trimesh(box.vertices, box.faces[1:], process=False))


@pytest.fixture
def estimated() -> Outline:
    return outline(uncertain(with_hole(), 0.001))


def test_dxf_is_read_by_ezdxf_in_millimetres(estimated: Outline, tmp_path: Path) -> None:
    save_outline(estimated, tmp_path / "part.dxf")
    drawing = ezdxf.readfile(tmp_path / "part.dxf")  # type: ignore[attr-defined]
    assert not drawing.audit().errors
    assert drawing.units == 4  # millimetres
    layers = {"outer": estimated.outer, "outline": estimated.polygon, "inner": estimated.inner}
    for name, polygon in layers.items():
        lines = drawing.modelspace().query(f'POLYLINE[layer=="{name}"]')
        rings = [
            shapely.Polygon([tuple(v.dxf.location)[:2] for v in line.vertices]) for line in lines
        ]
        assert all(line.is_closed for line in lines)
        outer, hole = sorted((ring.area for ring in rings), reverse=True)
        assert outer - hole == pytest.approx(1e6 * polygon.area, rel=1e-6)


def test_svg_has_the_same_rings_upside_down(estimated: Outline, tmp_path: Path) -> None:
    save_outline(estimated, tmp_path / "part.svg")
    root = ET.parse(tmp_path / "part.svg").getroot()
    groups = {group.get("id"): group for group in root}
    assert list(groups) == ["outer", "outline", "inner"]
    path = str(groups["outline"][0].get("d"))
    rings = [
        np.array([point.split() for point in ring[2:].removesuffix(" Z ").split("L")], dtype=float)
        for ring in (path + " ").split("M")[1:]
        for ring in ["M" + ring.replace("Z", "").rstrip()]
    ]
    areas = sorted(shapely.Polygon(ring).area for ring in rings)
    assert areas == pytest.approx([400.0, 3600.0])
    x, y, width, height = map(float, str(root.get("viewBox")).split())
    low, high = 1e3 * np.reshape(estimated.outer.bounds, (2, 2))
    assert x < low[0]
    assert x + width > high[0]
    assert y < -high[1]
    assert y + height > -low[1]


def test_equal_outlines_make_equal_bytes(estimated: Outline, tmp_path: Path) -> None:
    for ending in (".dxf", ".svg"):
        for name in ("a", "b"):
            save_outline(estimated, tmp_path / f"{name}{ending}")
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()
    with pytest.raises(InvalidOptionError):
        save_outline(estimated, tmp_path / "part.pdf")


def test_the_verb_writes_what_the_function_returns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = uncertain(trimesh.creation.box(SIDES).subdivide(), 0.001)
    save_surface(mesh, tmp_path / "surface.ply", header=describe(estimator="blend"))
    call = ["outline", str(tmp_path), "--axis", "x", "--clearance-for", "0.8"]
    assert main([*call, "--output", str(tmp_path / "out")]) == 0
    save_outline(outline(mesh, "x", clearance_for=0.8), tmp_path / "own.dxf")
    written = tmp_path / "out" / "outline.dxf"
    assert written.read_bytes() == (tmp_path / "own.dxf").read_bytes()
    assert f"{1e3 * scales(0.8)[0] * 0.001:.1f} mm" in "".join(capsys.readouterr())
