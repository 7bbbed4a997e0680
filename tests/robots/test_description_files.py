"""Robot descriptions as people have them: names of files, other kinds of files, mistaken units."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, LisGraspError
from lis_grasp.robots._build_model import read_description
from lis_grasp.robots._urdf import parse_xml
from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.draft.yaml_text import hand_yaml
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_bodies import load_link_mesh
from lis_grasp.robots.model_uri import resolve_uri

BOX = '<geometry><box size="0.1 0.02 {height}"/></geometry>'
MASS = '<inertial><mass value="0.1"/></inertial>'
LINK = f'<link name="{{name}}">{MASS}<collision>{{body}}</collision></link>'
LIMIT = '<limit lower="0" upper="0.04" effort="40" velocity="1"/>'
JOINT = (
    '<joint name="{name}" type="prismatic"><parent link="base"/><child link="{name}_tip"/>'
    '<origin xyz="{x} 0 0.06"/><axis xyz="1 0 0"/>{limit}{mimic}</joint>'
)


def urdf(
    *,
    body: str = BOX.format(height=0.06),
    limit: str = LIMIT,
    mimics: tuple[str, str] = ("", ""),
    x: float = 0.006,
    names: tuple[str, str, str] = ("base", "left_tip", "right_tip"),
) -> str:
    links = "".join(LINK.format(name=name, body=body) for name in names)
    joints = "".join(
        JOINT.format(
            name=name, x=x, limit=limit, mimic=f'<mimic joint="{leader}"/>' if leader else ""
        )
        for name, leader in zip(("left", "right"), mimics, strict=True)
    )
    return f'<?xml version="1.0"?>\n<robot name="grip">{links}{joints}</robot>\n'


SDF = (
    '<?xml version="1.0"?><sdf version="1.7"><model name="grip"><link name="base"/>'
    '<link name="tip"><inertial><mass>0.1</mass></inertial><collision name="c"><geometry><box>'
    "<size>0.1 0.1 0.1</size></box></geometry></collision></link><joint name='slide'"
    " type='prismatic'><parent>base</parent><child>tip</child><axis><xyz>1 0 0</xyz><limit>"
    "<lower>0</lower><upper>0.04</upper><effort>9</effort></limit></axis></joint></model></sdf>"
)


@pytest.mark.parametrize(
    ("uri", "place"),
    [
        ("package://Lab Hand/meshes/Base Link.STL", "Lab Hand/urdf"),
        ("package://Lab%20Hand/meshes/Base%20Link.STL", "Lab Hand/urdf"),
        ("model://Lab Hand/meshes/Base Link.STL", "Lab Hand"),
        ("$(find Lab Hand)/meshes/Base Link.STL", "Lab Hand/urdf"),
        ("../meshes/Base%20Link.STL", "Lab Hand/urdf"),
        ("..\\meshes\\Base Link.STL", "Lab Hand/urdf"),
        ("file:../meshes/Base Link.STL", "Lab Hand/urdf"),
        ("file://{root}/src/Lab%20Hand/meshes/Base%20Link.STL", "."),
        ("package://Lab Hand/meshes/Base Link.STL", "robots/cell"),  # src/Lab Hand: one level down
    ],
)
def test_each_way_to_name_a_mesh_finds_the_file(uri: str, place: str, tmp_path: Path) -> None:
    mesh = tmp_path / "src" / "Lab Hand" / "meshes" / "Base Link.STL"
    folder = (tmp_path if place.startswith("robots") else tmp_path / "src") / place
    for made in (mesh.parent, folder):
        made.mkdir(parents=True, exist_ok=True)
    mesh.write_text("solid")
    assert resolve_uri(uri.format(root=tmp_path), folder, "hand.urdf").samefile(mesh)


@pytest.mark.parametrize("uri", ["meshes/base link.stl", "package://lab/meshes/Base Link.stl"])
def test_a_name_in_other_letters_is_answered_by_the_whole_path_of_the_file(
    uri: str, tmp_path: Path
) -> None:
    folder = tmp_path / ("long_" * 20) / "lab"
    mesh = folder / "meshes" / "Base Link.STL"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("solid")
    with pytest.raises(LisGraspError, match=re.escape(str(mesh))):
        resolve_uri(uri, folder, "hand.urdf")


@pytest.mark.parametrize("uri", ["meshes/a.stl", "package://lab/a.stl", "http://x/a.stl", "lab"])
def test_a_file_that_is_not_there_is_named_in_full(uri: str, tmp_path: Path) -> None:
    folder = tmp_path / ("long_" * 20)
    (folder / "lab").mkdir(parents=True)
    with pytest.raises(LisGraspError, match=re.escape(uri.removeprefix("package://"))) as caught:
        resolve_uri(uri, folder, "hand.urdf")
    assert "..." not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("blank.urdf", "\n\n" + urdf()),
        ("comment.urdf", "<!-- made by a program -->\n" + urdf()),
        ("warnings.urdf", "xacro: in-order processing became default in ROS Melodic.\n" + urdf()),
        ("capital.SDF", SDF),
        ("sdf.xml", SDF),
    ],
)
def test_a_description_is_known_by_its_content(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert read_description(path).links[0] == "base"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
        ("\n<!DOCTYPE html><html><body>hand.urdf</body>", "a web page, .*: download the file"),
        ("#usda 1.0\n", "it is USD"),
        ("PK\x03\x04", "a ZIP archive, .*: unpack it"),
        ("", "it is empty"),
        ("<model><sdf version='1.6'>hand.sdf</sdf></model>", "give hand.sdf, which it names"),
        (urdf(names=("base", "left_tip", "left_tip")), "2 links are named 'left_tip'"),
        (SDF.replace('"base"/>', '"tip"/>'), "2 links are named 'tip'"),
        (urdf().replace("<link", "<!-- a--b --><link", 1), "a comment must not contain '--'"),
        (urdf(mimics=("left", "")), "left mimics itself"),
        (urdf(mimics=("right", "left")), "left, right mimic each other"),
        (urdf(limit='<limit effort="1"/>'), "lower and an upper limit; the file gives none"),
        (urdf(limit='<limit lower="0" effort="1"/>'), "upper limit; the file gives one of them"),
        (urdf(limit='<limit lower="0" upper="1"/>'), "effort above 0; the file gives none"),
        (
            urdf(body=BOX.format(height=60)),
            r"longest body .* 'base' with 60 m.* mm \(then 0\.06 m\)",
        ),
        (
            urdf(limit=LIMIT.replace("0.04", "0,04")),
            "has '0,04' where a number is needed: .* decimal point",
        ),
        (urdf()[:300], "it is cut off: download or export it again"),
        (urdf().replace('<parent link="base"/>', ""), "joint 'left' lacks <parent>"),
        (urdf(body="<geometry/>"), "link 'base' lacks a shape"),
        (urdf().replace('xyz="1 0 0"', 'xyz="1 0"'), "'left' lacks three numbers in xyz='1 0'"),
        (urdf(body="<geometry><sphere/></geometry>"), "it lacks radius"),
        (urdf() + "<more/>", "line 3 is no XML"),
        ("<robot name='grip'/>", "there must be links; there are none"),
        (urdf().replace('child link="left_tip"', 'child link="tip"'), "'left' joins 'tip', which"),
        (urdf().replace('parent link="base"', 'parent link="left_tip"'), "base, right_tip|loop"),
        (urdf(x=6.0), "'left' must be within 3 m of its parent link; it is 6 m away"),
    ],
)
def test_what_cannot_be_a_hand_is_named_as_what_it_is(
    text: str, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "hand.urdf"
    path.write_text(text)
    with pytest.raises(LisGraspError, match=reason) as caught:
        read_description(path)
    assert "None" not in str(caught.value)


def test_text_that_is_not_utf_8_is_named(tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    path.write_bytes(urdf().replace("grip", "Gr\u00fcn").encode("latin-1"))
    with pytest.raises(LisGraspError, match="UTF-8"):
        read_description(path)
    path.write_bytes(urdf().replace('"1.0"', '"1.0" encoding="latin-1"').encode("latin-1"))
    assert len(read_description(path).links) == 3


@pytest.mark.parametrize(("scale", "reason"), [(1e3, "'base' with 60 m"), (1e-3, "with 6e-05 m")])
def test_meshes_a_thousand_times_too_large_or_small_are_named(
    scale: float, reason: str, tmp_path: Path
) -> None:
    trimesh.creation.box([0.03, 0.02, 0.06]).apply_scale(scale).export(tmp_path / "m.stl")
    path = tmp_path / "hand.urdf"
    path.write_text(urdf(body='<geometry><mesh filename="m.stl"/></geometry>'))
    with pytest.raises(LisGraspError, match=reason):
        read_description(path)


@pytest.mark.parametrize(
    ("macro", "reason"),
    [
        ('<link name="${9 ** 9 ** 9}"/>', "no end within"),
        ('<link name="${1 / 0}"/>', "division by zero"),
        ('<xacro:include filename="hand.xacro"/>', "recursion"),
        ('<link name="$(find nowhere)${1}"/>', "no folder 'nowhere' is [^']*$"),
    ],
)
def test_macros_that_cannot_be_expanded_end_in_a_sentence(
    macro: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("xacro")
    if reason == "no end within":
        monkeypatch.setattr("lis_grasp.robots._xacro._LONGEST", 2.0)
    path = tmp_path / "hand.xacro"
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    path.write_text(f'<robot name="hand" {space}>{macro}</robot>')
    with pytest.raises(InvalidHandError, match=reason):
        parse_xml(path)


@pytest.mark.parametrize(
    ("inside", "advice"),
    [
        ('<link name="$(arg prefix)base"/>', "prefix:=VALUE"),
        (
            '<xacro:arg name="dof" default=""/><xacro:if value="${0 == 1}"><link name="a"/>'
            "</xacro:if>",
            "dof:=VALUE",
        ),
        ('<xacro:macro name="m" params=""><link name="a"/></xacro:macro>', "calls its macros"),
        ('<link name="$(env LIS_GRASP_TEST_UNSET)"/>', "LIS_GRASP_TEST_UNSET"),
        ('<xacro:include filename="$(find nowhere_at_all)/a.xacro"/>', "LIS_GRASP_MODELS"),
    ],
)
def test_a_xacro_file_that_lacks_something_says_once_how_to_give_it(
    inside: str, advice: str, tmp_path: Path
) -> None:
    pytest.importorskip("xacro")
    path = tmp_path / "hand.urdf.xacro"
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    path.write_text(f'<robot name="hand" {space}>{inside}</robot>')
    with pytest.raises(InvalidHandError) as error:
        parse_xml(path)
    assert error.value.file == path.name
    assert str(error.value).count(advice) == 1


def test_packages_are_searched_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home(path: str) -> str:
        return path  # as os.path.expanduser does for a user without an entry

    def raises(cls: type[Path]) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", no_home)
    monkeypatch.setattr(Path, "home", classmethod(raises))
    with pytest.raises(InvalidFileError):
        resolve_uri("package://drake_models/no/such.urdf", Path(), "a test")


def test_xacro_finds_packages_beside_it_without_ros(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    package = tmp_path / "lab_description"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    trimesh.creation.box([0.03, 0.02, 0.06]).export(package / "meshes" / "m.stl")
    mesh = '<mesh filename="package://lab_description/meshes/m.stl" scale="${s} 1 1"/>'
    whole = urdf(body=f"<geometry>{mesh}</geometry>")
    inside = whole[whole.index("<link") : whole.index("</robot>")]
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    (package / "urdf" / "parts.xacro").write_text(f"<robot {space}>{inside}</robot>")
    path = package / "hand.urdf.xacro"
    path.write_text(
        f'<robot name="grip" {space}><xacro:property name="s" value="${{0.5 * 4}}"/>'
        '<xacro:include filename="$(find lab_description)/urdf/parts.xacro"/></robot>'
    )
    model = read_description(path)
    assert model.links == ("base", "left_tip", "right_tip")
    np.testing.assert_allclose(model.link_geometries[0].mesh.extents, [0.06, 0.02, 0.06])
    text = path.read_text().replace("find lab_description", "find nobodys_description")
    path.write_text(text)
    with pytest.raises(LisGraspError, match="'nobodys_description'"):
        read_description(path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (urdf(mimics=("left", "")), "left mimics itself"),
        (urdf(), "fingertips left_tip and right_tip are at one place"),
        (SDF, "only tip moves, and no body of base is opposite to it"),
    ],
)
def test_what_cannot_be_drafted_is_said_of_the_file(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    path.write_text(text)
    with pytest.raises(InvalidHandError, match=f"^{re.escape(str(path))}: .*{reason}") as caught:
        draft_hand(path, name="hand", rng=np.random.default_rng(0))
    assert caught.value.file == "hand.urdf"


@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "glb"])
def test_the_mesh_of_a_link_is_upright_in_every_format(tmp_path: Path, ending: str) -> None:
    upright = trimesh.creation.box([0.1, 0.2, 0.3]).apply_translation([0.01, 0.02, 0.5])
    written = upright.copy()
    if ending == "glb":  # glTF has +y up: x, z, -y
        written.vertices = np.column_stack(
            [upright.vertices[:, 0], upright.vertices[:, 2], -upright.vertices[:, 1]]
        )
    path = tmp_path / f"link.{ending}"
    written.export(path)
    np.testing.assert_allclose(load_link_mesh(path, None).bounds, upright.bounds, atol=1e-6)
    scaled = load_link_mesh(path, [1.0, 2.0, 3.0])  # along the link's axes
    np.testing.assert_allclose(scaled.bounds, upright.bounds * [1.0, 2.0, 3.0], atol=1e-6)


def test_arguments_of_a_xacro_file_are_given_and_kept_in_the_hands_yaml(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    inside = "".join(
        LINK.format(name=name, body=f"<origin xyz='0 0 0.03'/>{BOX.format(height=0.06)}")
        for name in ("base", "$(arg side)_tip", "right_tip")
    )
    for name, side in (("$(arg side)", 1), ("right", -1)):
        joint = JOINT.format(name=name, x=0.06 * side, limit=LIMIT, mimic="")
        inside += joint.replace('axis xyz="1', f'axis xyz="{side}')
    path = tmp_path / "grip.urdf.xacro"
    argument = '<xacro:arg name="side" default="a"/>'
    path.write_text(f'<robot name="grip" {space}>{argument}{inside}</robot>')
    given = {"side": "1"}
    draft = draft_hand(path, name="grip", xacro_args=given, rng=np.random.default_rng(0))
    (tmp_path / "grip.yaml").write_text(hand_yaml(draft.hand, path.name, draft.edits))
    hand = Hand.load(tmp_path / "grip.yaml")
    assert (set(hand.joint_names), draft.edits.xacro_args) == ({"1", "right"}, given)
    with pytest.raises(InvalidHandError, match="no argument sides; its arguments are side"):
        parse_xml(path, {"sides": "left"})
    (tmp_path / "plain.urdf").write_text(urdf())
    with pytest.raises(InvalidHandError, match="xacro_args"):
        parse_xml(tmp_path / "plain.urdf", given)
