"""Records at home in NumPy, pandas, Drake, scikit-learn's words, and notebooks."""

from __future__ import annotations

import copy
import pickle
from base64 import b64encode
from dataclasses import asdict, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from made_grasps import jaw_grasp
from numpy.testing import assert_array_equal

import lis_grasp as lg
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidFileError, InvalidOptionError
from lis_grasp.geometry import as_pose, make_pose, require_pose
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.shapes.placement import placed

AXES = np.vstack([np.eye(3), -np.eye(3)])
CONTACTS = Contacts(0.03 * AXES, AXES, forces=np.arange(6.0), fingers=tuple("abcabc"))
GRIPPER = lg.Hand.load("wsg50")


def made_grasp() -> lg.Grasp:
    return jaw_grasp(GRIPPER, np.zeros(3), 0.04)


SEARCH = GraspSearch((made_grasp(), made_grasp()), {"collision": 3}, 5)


class RigidTransform:
    """A pose as Drake's class gives it, without Drake."""

    def __init__(self, X: np.ndarray) -> None:
        self._X = X

    def GetAsMatrix4(self) -> np.ndarray:
        return self._X


X = make_pose([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [0.1, 0.2, 0.3])


def test_contacts_are_an_array_of_points_and_normals() -> None:
    assert_array_equal(np.asarray(CONTACTS), np.hstack([CONTACTS.points, CONTACTS.normals]))
    assert np.asarray(CONTACTS, dtype=np.float32).dtype == np.float32
    with pytest.raises(ValueError, match="copy"):
        np.asarray(CONTACTS, copy=False)


def test_a_table_has_the_columns_of_a_file_and_makes_the_contacts_again() -> None:
    pytest.importorskip("pandas")
    table = CONTACTS.to_pandas()
    names = ["x", "y", "z", "nx", "ny", "nz", "force", "finger"]
    assert list(table.columns) == names
    again = Contacts(
        table[["x", "y", "z"]],
        table[["nx", "ny", "nz"]],
        forces=table["force"],
        fingers=tuple(table["finger"]),
    )
    assert again == CONTACTS


def test_a_table_of_grasps_has_a_row_each_by_rank() -> None:
    pytest.importorskip("pandas")
    table = SEARCH.to_pandas()
    assert list(table.index) == [1, 2]
    assert table.loc[1, "epsilon"] == SEARCH.best.epsilon
    assert_array_equal(table.loc[1, ["x", "y", "z"]].astype(float), SEARCH.best.X_OH[:3, 3])


def test_pandas_takes_contacts_and_searches_by_themselves() -> None:
    pandas = pytest.importorskip("pandas")
    assert_array_equal(pandas.DataFrame(CONTACTS), np.asarray(CONTACTS))
    table = pandas.DataFrame(SEARCH)
    assert list(table["hand"]) == ["wsg50", "wsg50"]
    assert table["quality"][1] == SEARCH[1].quality


def test_a_grasp_is_a_dictionary_and_its_quality_is_read_only() -> None:
    grasp = made_grasp()
    assert asdict(grasp)["quality"] == {"epsilon": 0.0}
    assert pickle.loads(pickle.dumps(grasp)) == grasp  # noqa: S301
    assert copy.deepcopy(grasp.quality) == grasp.quality
    for change in (
        lambda q: q.update(epsilon=1.0),
        lambda q: q.__setitem__("epsilon", 1.0),
        lambda q: q.pop("epsilon"),
        lambda q: q.setdefault("more", 1.0),
        lambda q: q.clear(),
    ):
        with pytest.raises(TypeError, match="read-only"):
            change(grasp.quality)
    assert grasp == made_grasp()


def test_a_table_without_pandas_names_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lis_grasp.exceptions.find_spec", lambda name: None)
    for record in (CONTACTS, SEARCH):
        with pytest.raises(InvalidOptionError) as error:
            record.to_pandas()
        assert error.value.option == "to_pandas"


def test_arrays_of_six_columns_and_of_no_file_are_answered() -> None:
    with pytest.raises(InvalidContactsError) as error:
        Contacts(np.asarray(CONTACTS), AXES)
    assert error.value.field == "points"
    with pytest.raises(InvalidFileError, match=r"\(N, 3\)"):
        lg.load_contacts([1, 2])


def test_equal_are_records_whose_numbers_are() -> None:
    same = Contacts(CONTACTS.points.copy(), AXES.copy(), np.arange(6.0), tuple("abcabc"))
    assert same == CONTACTS
    assert hash(same) == hash(CONTACTS)
    assert same != CONTACTS[:5]
    assert same != replace(CONTACTS, forces=None)
    assert same != replace(CONTACTS, points=CONTACTS.points + 1e-12)
    unknown = replace(CONTACTS, position_noise=np.array([np.nan, *np.ones(5)]))
    assert unknown == replace(CONTACTS, position_noise=np.array([np.nan, *np.ones(5)]))
    assert CONTACTS != "contacts"
    assert made_grasp() == made_grasp()
    assert replace(SEARCH, candidates=6) != SEARCH


def test_a_pose_of_drake_is_taken_wherever_an_array_is() -> None:
    drake, box = RigidTransform(X), lg.shapes.build("box")
    assert_array_equal(as_pose(drake), X)
    assert_array_equal(require_pose("X_WO", drake), X)
    assert CONTACTS.in_frame(drake) == CONTACTS.in_frame(X)
    assert_array_equal(placed(box, drake).mesh.vertices, placed(box, X).mesh.vertices)
    assert replace(made_grasp(), X_OH=drake) == replace(made_grasp(), X_OH=X)
    of_drake, of_array = (GRIPPER.forward_kinematics(p, GRIPPER.lower) for p in (drake, X))
    for link in GRIPPER.links:
        assert_array_equal(of_drake[link], of_array[link])


def test_drake_s_own_pose_is_one() -> None:
    math = pytest.importorskip("pydrake.math")
    assert_array_equal(as_pose(math.RigidTransform(X)), X)


@pytest.mark.parametrize("name", ["blend", "gpis", "smooth", "lis", "patch"])
@pytest.mark.parametrize("height", [None, -0.03])
def test_a_surface_is_called_and_predicts(name: str, height: float | None) -> None:
    surface = lg.estimate(CONTACTS, name, support_height=height)
    points = np.random.default_rng(0).uniform(-0.04, 0.04, (5, 3))
    assert_array_equal(surface(points), surface.evaluate(points))
    assert_array_equal(surface.predict(points), surface.evaluate(points))
    mean, deviation = surface.predict(points, return_std=True)
    assert_array_equal(surface.predict(points, True), [mean, deviation])  # as scikit-learn's
    assert_array_equal(mean, surface.evaluate(points))
    assert_array_equal(deviation, surface.uncertainty(points))


def test_a_notebook_displays_contacts_grasps_and_runs(tmp_path: Path) -> None:
    shown = CONTACTS._repr_html_()
    picture = ElementTree.fromstring(shown[: shown.index("</svg>") + 6])
    circles = picture.findall(".//{http://www.w3.org/2000/svg}circle")
    assert len(circles) == len(CONTACTS)
    places = np.array([[float(c.get(key)) for key in ("cx", "cy")] for c in circles])
    size = np.array([float(picture.get(key)) for key in ("width", "height")])
    assert np.all((places > 0.0) & (places < size))
    assert len(shown) < 3000
    assert "<circle" not in Contacts.empty()._repr_html_()
    run = lg.Run(tmp_path, {}, CONTACTS, None, None, None, None)
    assert ElementTree.fromstring(run._repr_html_()).find("iframe") is None
    (tmp_path / "scene.html").write_text("<b>page</b>")
    (tmp_path / "scene.png").write_bytes(b"picture")
    shown = ElementTree.fromstring(run._repr_html_())
    assert shown.find("iframe").get("srcdoc") == "<b>page</b>"
    assert shown.find("summary/img").get("src").endswith(b64encode(b"picture").decode())
    table = ElementTree.fromstring(SEARCH._repr_html_())
    assert len(table.findall("./tbody/tr")) == 2
    assert "3" in GraspSearch((), {"collision": 3}, 3)._repr_html_()
