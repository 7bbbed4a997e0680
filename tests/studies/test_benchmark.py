"""The touch benchmark: what is frozen, what a plug-in is, its scores, its row."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.stats import ttest_1samp

from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.grasping.samplers import make_planner
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import build
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp_studies.benchmark import baselines, objects, protocol
from lis_grasp_studies.benchmark.antipodal import AntipodalPlanner
from lis_grasp_studies.benchmark.baselines import baseline_rows, store_baselines
from lis_grasp_studies.benchmark.objects import FOLDER, stored_object
from lis_grasp_studies.benchmark.outsiders import OUTSIDERS
from lis_grasp_studies.benchmark.protocol import Protocol, kind_of
from lis_grasp_studies.benchmark.row import benchmark_row, scores_of
from lis_grasp_studies.benchmark.scores import MEASURES, Measure, score_table, scores
from lis_grasp_studies.benchmark.tracks import (
    LiftTrial,
    StoredTrial,
    measure_planner,
    measure_surfaces,
)
from lis_grasp_studies.evaluation.results import EvaluationResults
from lis_grasp_studies.evaluation.touched_shapes import HULL, NOISE
from lis_grasp_studies.harness.statistics import LEAST_CLUSTERS
from lis_grasp_studies.harness.tables import where
from lis_grasp_studies.test_objects.salted import MIXED_FAMILIES, salted_shape

ANTIPODAL = "lis_grasp_studies.benchmark.antipodal:AntipodalPlanner"
# Of protocol_1.yaml. A change of the file is another protocol: write protocol_2.yaml beside it.
FROZEN = "0afe8d63fe5a7d28"


def test_the_first_protocol_is_frozen() -> None:
    content = (FOLDER / "protocol_1.yaml").read_bytes()
    assert hashlib.sha256(content).hexdigest()[:16] == FROZEN
    assert Protocol.load().version == 1


def test_other_objects_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    changed = dict(objects.stored_objects(1))
    changed["0 contacts"] = changed["0 contacts"] + np.float32(1e-6)
    monkeypatch.setattr(protocol, "stored_objects", lambda version: changed)
    with pytest.raises(InvalidFileError):
        Protocol.load()


def test_the_stored_objects_are_those_of_the_salt() -> None:
    salt = Protocol.load().salt
    for number in range(100):
        shape, _ = stored_object(1, number)
        made = salted_shape(salt, number, MIXED_FAMILIES)
        assert shape.name == made.name
        assert shape.mesh.is_watertight
        # float32 keeps 24 bits: of 0.1 m, 3 nm.
        np.testing.assert_allclose(shape.mesh.bounds, made.mesh.bounds, atol=1e-8)
        assert shape.mesh.volume == pytest.approx(made.mesh.volume, rel=1e-5)


def test_the_stored_contacts_have_the_noise_of_the_sensor() -> None:
    errors, angles = [], []
    for number in range(100):
        shape, contacts = stored_object(1, number)
        assert len(contacts) == 40
        distances, faces = distances_to_mesh(contacts.points, shape.mesh)
        errors.append(distances)
        angles.append(np.einsum("ni,ni->n", contacts.normals, shape.mesh.face_normals[faces]))
    rms = np.sqrt(np.mean(np.concatenate(errors) ** 2))
    # Noise along a face shows only where it leaves the face: at edges.
    assert 0.9 * NOISE["position_noise"] < rms < 1.3 * NOISE["position_noise"]
    assert np.median(np.concatenate(angles)) > np.cos(2.0 * NOISE["normal_noise"])


def test_the_judge_finds_what_the_protocol_says() -> None:
    rows = {
        r["object"]: r for n in range(3) for r in measure_surfaces(StoredTrial(1, n), HULL)[-1:]
    }
    for name, expected in Protocol.load().judge.items():
        of, _, column = name.partition(" ")
        assert rows[of][column] == pytest.approx(expected, rel=1e-4), name


PLUGINS = """
import numpy as np
class Plane:
    def __init__(self, contacts):
        self.bounds = contacts.bounds
    def evaluate(self, points):
        return points[..., 2]
class Policy:
    def __init__(self, space):
        self.space = space
    def next_probe(self, contacts, surface, *, outcomes, rng):
        return None
class Choosy:
    def __init__(self, space):
        self.size = space.size
    next_probe = Policy.next_probe
def neither(something):
    return 3
"""


def test_a_plugin_is_what_it_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "kinds_of_plugins.py").write_text(PLUGINS)
    names = {"Plane": "estimator", "Policy": "policy", "Choosy": "policy"}
    for name, kind in names.items():
        assert kind_of(f"kinds_of_plugins:{name}") == kind
    for name, kind in (("blend", "estimator"), ("hull", "estimator"), ("spread", "policy")):
        assert kind_of(name) == kind
    assert kind_of("wsg50") == kind_of("my_hand.yaml") == "hand"
    for wrong in ("kinds_of_plugins:neither", "blendd"):
        with pytest.raises(InvalidOptionError):
            kind_of(wrong)


def rows_of(values: list[float]) -> list[dict]:
    return [{"object": f"o{k}", "x": value} for k, value in enumerate(values)]


LOW = Measure("x", "mm", "lower", lambda row: row["x"])
HIGH = Measure("x", "%", "higher", lambda row: row["x"])


def test_a_score_is_a_loss_where_the_interval_of_the_difference_says_so() -> None:
    rng = np.random.default_rng(0)
    theirs = rng.uniform(1.0, 2.0, 30)
    worse = list(theirs + rng.uniform(0.1, 0.3, 30))
    same = list(theirs + rng.normal(0.0, 0.1, 30) * np.where(np.arange(30) % 2, 1.0, -1.0))
    others = {"base": rows_of(list(theirs))}
    loss, win = (scores("t", [m], rows_of(worse), others)[0] for m in (LOW, HIGH))
    assert (loss.verdict, win.verdict) == ("loss", "win")
    low, high = loss.difference
    assert low is not None
    assert high is not None
    assert low < np.mean(worse) - np.mean(theirs) < high
    (tie,) = scores("t", [LOW], rows_of(same), others)
    assert tie.verdict == "equal"  # 0.1 of noise, a margin of 0.5
    table = score_table([win, tie, loss], "mine")
    assert [line[5] for line in table.body] == ["loss", "equal", "win"]


@pytest.mark.parametrize("count", [9, 12, 24, 60])
@pytest.mark.parametrize("spread", [0.3, 1.0, 3.0])
def test_a_tie_is_equal_only_where_its_interval_of_90_percent_is_within_the_margin(
    count: int, spread: float
) -> None:
    rng = np.random.default_rng([count, int(10 * spread)])
    theirs = rng.uniform(1.0, 2.0, count)
    mine = list(theirs + spread * rng.normal(size=count))
    (score,) = scores("t", [LOW], rows_of(mine), {"base": rows_of(list(theirs))})
    ends = ttest_1samp(np.array(mine) - theirs, 0.0).confidence_interval(0.9)
    within = -0.5 < ends.low < ends.high < 0.5 and count >= LEAST_CLUSTERS
    if score.verdict in ("loss", "win"):
        return
    assert score.verdict == ("equal" if within else "unclear")


def test_a_row_says_of_every_tie_what_could_have_been_shown() -> None:
    protocol = Protocol.load()
    stored = where(baseline_rows(1), part="surfaces", estimator="smooth")
    parts = {"surfaces": stored}
    found = scores_of(protocol, "smooth", parts)
    row = benchmark_row(protocol, "smooth", "estimator", parts, found)
    kinds = ("losses", "unclear", "equal", "wins")
    assert sum(len(row[kind]) for kind in kinds) == len(found)
    for tie in (*row["unclear"], *row["equal"]):
        low, high = tie["difference"]
        assert low is None or low <= 0.0 <= high
    assert all(tie["p_equal"] < 0.05 for tie in row["equal"])
    assert all(tie["p_equal"] >= 0.05 for tie in row["unclear"])
    assert all(tie["detectable"] > 0.0 for tie in row["unclear"])
    json.dumps(row, allow_nan=False)


def test_objects_without_a_baseline_are_not_compared() -> None:
    mine = rows_of([1.0, 2.0, 3.0, 4.0])
    (score,) = scores("t", [LOW], mine, {"base": rows_of([5.0, 5.0])})
    assert (score.objects, score.pairs, score.mean, score.baseline_mean) == (4, 2, 2.5, 5.0)
    (alone,) = scores("t", [LOW], mine, {})
    assert (alone.baseline, alone.verdict) == ("", "")


def test_an_estimate_that_failed_is_the_worst_in_every_measure() -> None:
    good, _ = measure_surfaces(StoredTrial(1, 0), HULL)
    failed = {key: good[key] for key in ("object", "family", "count")}
    failed |= {"failure": "no surface", "slot": 0.099, "wall": 0.099}
    for measure in MEASURES["stored_tasks"]:
        if measure.count == good["count"]:
            numbers = [measure.value(row) for row in (failed, good)]
            assert None not in numbers or measure.name == "extents inside", measure.name
            if None not in numbers:
                worst, better = numbers if measure.better == "lower" else numbers[::-1]
                assert worst > better, measure.name


def test_the_stored_baselines_are_of_the_protocol() -> None:
    tracks, rows = Protocol.load().tracks, baseline_rows(1)
    for row in rows:
        track = tracks[row["part"]]
        assert row[track.experiment.variant] in (*track.variants, *OUTSIDERS)
        assert row["number"] < track.objects
    measured = {row["estimator"] for row in where(rows, part="surfaces")}
    assert measured == {*tracks["surfaces"].variants, *OUTSIDERS}


def test_stored_rows_replace_those_of_the_same_name_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = baseline_rows(1)
    row = {**before[0], "rmsd": 0.123456789, "job_seconds": 2.0, "commit": "abc"}
    new = {**row, "estimator": OUTSIDERS[0], "number": 7}
    EvaluationResults(tmp_path / "out").lines.append([row, new])
    monkeypatch.setattr(baselines, "FOLDER", tmp_path)
    (tmp_path / "baselines_1.jsonl").write_bytes((FOLDER / "baselines_1.jsonl").read_bytes())
    assert store_baselines(Protocol.load(), [tmp_path / "out"]) == 2
    after = baseline_rows(1)
    of_row = {"part": row["part"], "estimator": row["estimator"]}
    assert [(r["object"], r["rmsd"]) for r in where(after, **of_row)] == [(row["object"], 0.12346)]
    assert [r["number"] for r in where(after, part=row["part"], estimator=OUTSIDERS[0])] == [7]

    def others(rows: list[dict]) -> list[dict]:
        names = (row["estimator"], OUTSIDERS[0])
        return [r for r in rows if r["part"] != row["part"] or r["estimator"] not in names]

    assert others(after) == others(before)


@pytest.mark.slow
def test_a_quick_run_writes_a_row_and_runs_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["benchmark", HULL, "--quick", "--tracks", "surfaces", "--jobs", "1"]
    command += ["--output", str(tmp_path / "out")]
    assert main(command) == 0
    row = json.loads((tmp_path / "out" / "row.json").read_text())
    assert (row["kind"], row["name"], row["protocol"]) == ("estimator", HULL, 1)
    assert row["tracks"]["surfaces"]["objects"] == 12
    assert {"slot", "walls"} <= {m["measure"] for m in row["tracks"]["surfaces"]["measures"]}
    assert any(loss["baseline"] == "blend" for loss in row["losses"])
    lines = (tmp_path / "out" / "rows.jsonl").read_bytes()
    assert main(command) == 0
    assert (tmp_path / "out" / "rows.jsonl").read_bytes() == lines


def test_a_track_of_another_kind_is_refused() -> None:
    with pytest.raises(InvalidOptionError):
        Protocol.load().configuration("policy", "spread", tracks=["surfaces"])


def test_a_planner_is_what_makes_sample_of_a_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = """
class Planner:
    def __init__(self, hand): self.hand = hand
    def sample(self, mesh, *, rng=0, support_height=None, count=10): {0}
class Nothing:
    def __init__(self, hand): pass
"""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    for name, body in (("plans", "return []"), ("fails", "return 1 / 0"), ("odd", "return 7")):
        Path(f"{name}.py").write_text(code.format(body))
        assert kind_of(f"{name}:Planner") == "planner"
    assert kind_of(ANTIPODAL) == kind_of("force_closure") == "planner"
    trial = LiftTrial(1, 0, "wsg50", 20, own=False)
    reasons = {
        name: measure_planner(trial, f"{name}:Planner") for name in ("plans", "fails", "odd")
    }
    assert reasons["plans"]["reason"] == "no grasp"
    assert "ZeroDivisionError at fails.py:4" in reasons["fails"]["reason"]
    assert "must return a Sequence; it returned int" in reasons["odd"]["reason"]
    assert {row["held"] for row in reasons.values()} == {0}
    with pytest.raises(InvalidOptionError, match="sample of a Hand"):
        kind_of("plans:Nothing")
    with pytest.raises(InvalidOptionError, match="has not"):
        make_planner("plans:Nothing", Hand.load("wsg50"))


def test_antipodal_pairs_face_each_other_and_come_in_their_own_order() -> None:
    planner = AntipodalPlanner(Hand.load("wsg50"))
    shape = build("cylinder")
    grasps = planner.sample(shape.mesh, support_height=shape.mesh.bounds[0, 2], count=3)
    assert len(grasps) == 3
    for grasp in grasps:
        first, second = grasp.contact_normals
        assert first @ second < -0.999
        line = np.subtract(*grasp.contact_points)
        assert abs(line @ first) > 0.999 * np.linalg.norm(line)
    again = planner.sample(shape.mesh, support_height=shape.mesh.bounds[0, 2], count=1)
    np.testing.assert_array_equal(again[0].pose, grasps[0].pose)
    assert not planner.sample(trimesh.creation.box(extents=[0.3, 0.3, 0.3]))
