"""3MF projects of slicers: only what is printed as matter is the object."""

import zipfile
from pathlib import Path

import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.exceptions import InvalidFileError

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_LINKS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="r"'
    ' Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
_SIZE = (60.0, 50.0, 40.0)
_VOLUME = 1.2e-4  # of the block [m3]
_TURN = "1 0 0 0 1 0 0 0 1"


def _mesh(size: tuple[float, ...], x: float = 0.0) -> str:
    box = trimesh.creation.box(size)
    vertices = "".join(f'<vertex x="{p[0] + x}" y="{p[1]}" z="{p[2]}"/>' for p in box.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box.faces)
    return f"<vertices>{vertices}</vertices><triangles>{faces}</triangles>"


def _object(number: int, body: str, attributes: str = "", settings: str = "") -> str:
    return f'<object id="{number}" {attributes}>{settings}<mesh>{body}</mesh></object>'


def _write(path: Path, objects: str, items: str, **files: str) -> Path:
    model = (
        f'<model unit="millimeter" xmlns="{_CORE}"><resources>{objects}</resources>'
        f"<build>{items}</build></model>"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("_rels/.rels", _LINKS)
        archive.writestr("3D/3dmodel.model", model)
        for name, text in files.items():
            archive.writestr(f"Metadata/{name}.config", text)
    return path


_BLOCK = _object(1, _mesh(_SIZE))
_ITEM = '<item objectid="1"/>'
_BIG = _mesh((100.0, 100.0, 100.0))
_BOTH = (
    f'{_BLOCK}{_object(2, _BIG)}<object id="3"><components><component objectid="1"/>'
    '<component objectid="2"/></components></object>'
)


def _bambu(subtype: str) -> str:
    return (
        '<config><object id="3"><part id="1" subtype="normal_part"/>'
        f'<part id="2" subtype="{subtype}"/></object></config>'
    )


def _prusa(key: str, value: str) -> str:
    return (
        '<config><object id="1"><volume firstid="0" lastid="11"/><volume firstid="12" lastid="23">'
        f'<metadata type="volume" key="{key}" value="{value}"/></volume></object></config>'
    )


def _two_volumes() -> str:
    block, big = trimesh.creation.box(_SIZE), trimesh.creation.box((100.0, 100.0, 100.0))
    both = trimesh.util.concatenate([block, big])
    rows = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in both.vertices)
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in both.faces)
    return _object(1, f"<vertices>{rows}</vertices><triangles>{corners}</triangles>")


def _cura(kind: str) -> str:
    return f'<metadatagroup><metadata name="cura:{kind}">True</metadata></metadatagroup>'


_HELPERS = {
    "not printed": (
        _BLOCK,
        f'{_ITEM}<item objectid="1" transform="{_TURN} 150 0 0" printable="0"/>',
        {},
    ),
    **{
        kind: (
            _BLOCK + _object(2, _BIG, f'type="{kind}"'),
            f'{_ITEM}<item objectid="2"/>',
            {},
        )
        for kind in ("support", "solidsupport", "surface", "other")
    },
    **{
        kind: (_BOTH, '<item objectid="3"/>', {"model_settings": _bambu(kind)})
        for kind in ("modifier_part", "support_blocker", "support_enforcer")
    },
    **{
        kind: (_two_volumes(), _ITEM, {"Slic3r_PE_model": _prusa("volume_type", kind)})
        for kind in ("ParameterModifier", "SupportBlocker", "SupportEnforcer")
    },
    "modifier of old": (_two_volumes(), _ITEM, {"Slic3r_PE_model": _prusa("modifier", "1")}),
    **{
        kind: (_BLOCK + _object(2, _BIG, settings=_cura(kind)), f'{_ITEM}<item objectid="2"/>', {})
        for kind in ("support_mesh", "infill_mesh", "anti_overhang_mesh")
    },
}


@pytest.mark.parametrize("name", _HELPERS)
def test_helpers_of_slicers_are_left_out_of_the_object_and_that_is_recorded(
    name: str, tmp_path: Path
) -> None:
    objects, items, files = _HELPERS[name]
    shape = shapes.load(_write(tmp_path / "a.3mf", objects, items, **files))
    # Single precision of Manifold is not involved: the block's own triangles are kept.
    assert shape.mesh.volume == pytest.approx(_VOLUME, rel=1e-9)
    assert any("left out 1 part" in repair for repair in shape.repairs)


def test_parts_that_are_matter_are_one_object(tmp_path: Path) -> None:
    files = {"model_settings": _bambu("normal_part")}
    shape = shapes.load(_write(tmp_path / "a.3mf", _BOTH, '<item objectid="3"/>', **files))
    assert shape.mesh.volume == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize(
    ("objects", "item", "files"),
    [
        (_BOTH, '<item objectid="3"/>', {"model_settings": _bambu("negative_part")}),
        (_two_volumes(), _ITEM, {"Slic3r_PE_model": _prusa("volume_type", "NegativeVolume")}),
        (_BLOCK + _object(2, _BIG, settings=_cura("cutting_mesh")), '<item objectid="2"/>', {}),
        (_BLOCK, '<item objectid="1" printable="0"/>', {}),
    ],
)
def test_parts_to_subtract_and_projects_without_matter_are_refused(
    objects: str, item: str, files: dict[str, str], tmp_path: Path
) -> None:
    path = _write(tmp_path / "a.3mf", objects, item, **files)
    with pytest.raises(InvalidFileError) as error:
        shapes.load(path)
    assert error.value.path == path
