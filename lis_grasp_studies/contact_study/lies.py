"""Contacts that lie: kinds of lies told about true contacts, what becomes of them, and tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from zlib import crc32

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import surface_error
from lis_grasp.exceptions import EstimationError, LisGraspError
from lis_grasp.io.json_lines import Row
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import ESTIMATORS, judge_contacts, orient_normals
from lis_grasp.surfaces.contact_preparation import with_approach
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp_studies.contact_study.contact_sets import ContactCase, ContactSet, contact_set
from lis_grasp_studies.contact_study.score import EXPLORED
from lis_grasp_studies.estimators import Noise
from lis_grasp_studies.harness.experiment import Experiment
from lis_grasp_studies.harness.tables import (
    NONE,
    Column,
    Table,
    columns_by,
    grouped_table,
    mean_cell,
    split,
    values_of,
    where,
)

DRAWS: tuple[tuple[str, int, float, float], ...] = (
    *(("even", 20, 0, 0), ("even", 40, 0, 0), ("even", 100, 0, 0), ("random", 40, 0, 0)),
    *(("random", 100, 0, 0), ("clustered", 60, 0, 0), ("half", 30, 0, 0), ("even", 60, 0.5, 3)),
    *(("even", 10, 0, 0), ("even", 60, 3, 15)),
)
"""Draw, number, noise [mm] and [degrees] of sets; the last two are hard: few, and noisy."""

HARD = DRAWS[-2:]

LIES: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "clean": (0, 0, 0),
        "one flip": (0, 0, 0),
        "5 % flips": (0.05, 0, 0),
        "10 % flips": (0.1, 0, 0),
        "20 % flips": (0.2, 0, 0),
        "35 % flips": (0.35, 0, 0),
        "half flipped": (0.5, 0, 0),
        "one wrong normal": (0, 0, 0),
        "stray at 0.5 sizes": (0, 0, 0.5),
        "stray at 1 size": (0, 0, 1),
        "stray at 5 sizes": (0, 0, 5),
        "empty row": (0, 0, 0),
        "5 % flips, 5 % strays": (0.05, 0.05, 0),
        "unsigned": (0.5, 0, 0),
        "unsigned, approach": (0.5, 0, 0),
        "10 % flips, approach": (0.1, 0, 0),
    }
)
"""Fractions of flips and of strays, and the distance of one stray in sizes, by the kind of lie."""

BELIEVED = ("one flip", "10 % flips", "stray at 1 size")
"""Kinds of which the errors are measured without the mechanism, too."""

SOUND, FLIPPED, WRONG_NORMAL, STRAY = range(4)

# Errors below this fraction of the size are as good as none: ratios of nothing mean nothing.
_FLOOR = 0.002
# Normals that differ by less are hardly wrong.
_WRONG = 0.8
_CELLS = 40


@dataclass(frozen=True, slots=True)
class LieTrial:
    """One set of contacts that lies are told about."""

    shape: str
    draw: str
    count: int
    millimetres: float
    degrees: float
    seed: int
    fits: int
    """1 to compare the errors of estimates, too."""


def tell(true: Contacts, kind: str, *, rng: np.random.Generator) -> tuple[Contacts, IndexArray]:
    """Return contacts with lies in random order, and what each is: `SOUND` to `STRAY`."""
    flips, strays, distance = LIES[kind]
    points, normals, count = true.points, true.normals.copy(), len(true)
    codes = np.full(count, SOUND)
    number = 1 if kind == "one flip" else round(flips * count) or int(flips > 0)
    codes[rng.choice(count, number, replace=False)] = FLIPPED
    normals[codes == FLIPPED] *= -1.0
    if kind == "one wrong normal":
        i = int(rng.integers(count))
        while (wrong := _direction(rng)) @ true.normals[i] > _WRONG:
            pass
        codes[i], normals[i] = WRONG_NORMAL, wrong
    added = [_outside(true, distance, rng)] if distance else []
    added += [np.zeros(3)] if kind == "empty row" else []
    added += [
        _outside(true, float(rng.choice([0.5, 1.0, 5.0])), rng)
        for _ in range(max(1, round(strays * count)) if strays else 0)
    ]
    for point in added:
        points, normals = np.vstack([points, point]), np.vstack([normals, _direction(rng)])
        codes = np.append(codes, STRAY)
    order = rng.permutation(len(points))
    return Contacts(points[order], normals[order]), codes[order]


def measure(trial: LieTrial, kind: str) -> Row:
    """Return the verdicts on a set with lies of a kind, and the ratios of errors to the truth's."""
    data, true = _true_set(trial)
    key = [trial.seed, crc32(f"{trial.shape} {trial.draw} {trial.count} {kind}".encode())]
    rng = np.random.default_rng(key)
    told, codes = tell(true, kind, rng=rng)
    row: Row = {"family": data.family, "bad": int(np.count_nonzero(codes))}
    if kind.endswith("approach"):
        true_normals = np.where(codes == FLIPPED, -1.0, 1.0)[:, None] * told.normals
        told = with_approach(told, _motions(true_normals, rng))
    if kind.startswith("unsigned"):
        try:
            signed = orient_normals(told)
        except EstimationError:
            return row | {"refused": True, "right": False}
        turned = np.sum(signed.normals * told.normals, axis=1) < 0.0
        return row | {"refused": False, "right": bool(np.all(turned == (codes == FLIPPED)))}
    verdicts = judge_contacts(told)
    judged = verdicts.bad
    row |= {
        "right": bool(np.array_equal(verdicts.codes == FLIPPED, codes == FLIPPED))
        and bool(np.array_equal(judged, codes > 0)),
        "said": bool(judged.any()),
        "found": int(np.count_nonzero(judged & (codes > 0))),
        "false": int(np.count_nonzero(judged & (codes == 0))),
        "contacts": int(np.count_nonzero(codes == 0)),
        "refused": True,
    }
    try:
        credible = verdicts.credible
    except EstimationError:
        return row
    row["refused"] = False
    if trial.fits:
        size = data.shape.size
        for name in ("blend", "gpis"):
            clean, within = _clean_score(trial, name)
            score = (clean, within) if row["right"] else _score(credible, data, name)
            row[name] = max(score[0], _FLOOR * size) / max(clean, _FLOOR * size)
            row[f"{name}_within"] = score[1]
            if kind in BELIEVED:
                raw = _score(replace(told, judged=True), data, name)[0]
                row[f"{name}_raw"] = max(raw, _FLOOR * size) / max(clean, _FLOOR * size)
    return row


def _true_set(trial: LieTrial) -> tuple[ContactSet, Contacts]:
    data = contact_set(trial.shape, ContactCase(trial.draw, trial.count), trial.seed)
    key = [trial.seed, crc32(trial.shape.encode()), trial.count, int(10 * trial.millimetres)]
    noise = Noise(1e-3 * trial.millimetres, float(np.deg2rad(trial.degrees)))
    return data, noise.disturb(data.exact, rng=np.random.default_rng(key))


@lru_cache(maxsize=64)
def _clean_score(trial: LieTrial, estimator: str) -> tuple[float, float | None]:
    data, true = _true_set(trial)
    return _score(replace(true, judged=True), data, estimator)


def _score(contacts: Contacts, data: ContactSet, estimator: str) -> tuple[float, float | None]:
    """Return the larger rms distance [m] between estimate and truth, and the 95 % band's rate."""
    size = data.shape.size
    try:
        surface = ESTIMATORS[estimator](contacts)
        low, high = surface.bounds
        mesh = extract_mesh(surface, resolution=float(np.max(high - low)) / _CELLS)
        error = surface_error(
            mesh, data.shape, data.exact, explored_radius=EXPLORED * size, samples=1000
        )
    except (LisGraspError, ArithmeticError, ValueError):
        return EXPLORED * size, None
    points = data.shape.mesh.sample(300, seed=0)
    points = points[cKDTree(data.exact.points).query(points)[0] <= EXPLORED * size]
    off = np.abs(surface.evaluate(points))
    within = float(np.mean(off <= 1.96 * surface.uncertainty(points)))
    return max(error.rmsd, error.rmsd_truth_to_estimate), within


def _motions(normals: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return directions (N, 3) of motions that end at normals (N, 3), by the cosine law."""
    motions = np.array([_direction(rng) for _ in normals]) - (1.0 + 1e-9) * normals
    return np.asarray(motions / np.linalg.norm(motions, axis=1, keepdims=True))


def _direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _outside(true: Contacts, sizes: float, rng: np.random.Generator) -> FloatArray:
    """Return a point at a distance, in sizes, from the contacts, in a random direction."""
    size, middle, direction = true.extent, true.points.mean(axis=0), _direction(rng)
    line = middle + np.linspace(0.0, (sizes + 2.0) * size, 4000)[:, None] * direction
    apart, _ = cKDTree(true.points).query(line)
    return np.asarray(line[min(int(np.flatnonzero(apart <= sizes * size).max()) + 1, 3999)])


EXPERIMENT = Experiment("lies", measure, asdict, variant="lie")
"""The experiment; its variants are the kinds of lies."""

CLOSE = 1.15
"""Largest ratio of errors of an estimate that is as good as from true contacts."""


def lie_tables(rows: Sequence[Row], order: Sequence[str]) -> list[Table]:
    """Return what is found by family, by kind of lie, on hard sets, and of clean sets by draw.

    Families are columns in their order.
    """
    hard = {(draw[1], draw[2]) for draw in HARD}
    is_hard = [(row["count"], row["millimetres"]) in hard for row in rows]
    hard_rows = [row for row, flag in zip(rows, is_hard, strict=True) if flag]
    main = [row for row, flag in zip(rows, is_hard, strict=True) if not flag]
    families = {kind: where(main, lie=kind) for kind in LIES}
    in_order = sorted(rows, key=lambda row: order.index(row["family"]))
    by_family = columns_by("family", in_order, _percent("right"))
    groups = {"main": main, "few or noisy": hard_rows}
    kinds = {(kind, name): where(of, lie=kind) for kind in LIES for name, of in groups.items()}
    clean = split(where(rows, lie="clean"), "draw", "count", "millimetres")
    verdicts = _COLUMNS[:6]
    columns = _COLUMNS if any("blend" in row for row in rows) else verdicts
    first = "draw | number | noise [mm]"
    return [
        grouped_table("lies_by_family", "Wholly right by family [%]", "lie", families, by_family),
        grouped_table("lies", "By kind of lie", "lie | sets", kinds, columns),
        grouped_table("clean", "Clean sets by draw", first, clean, verdicts),
    ]


def _percent(*columns: str) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the percentage of rows in which one of some columns is true."""

    def cell(rows: Sequence[Row]) -> str:
        true = [any(row.get(name) for name in columns) for row in rows]
        return f"{100.0 * np.mean(true):.1f}" if true else NONE

    return cell


def _per_contact(part: str, whole: str) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        total = values_of(rows, whole).sum()
        return f"{100.0 * values_of(rows, part).sum() / total:.2f}" if total else NONE

    return cell


def _ratios(name: str) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the rate of ratios up to `CLOSE`, and their geometric mean."""

    def cell(rows: Sequence[Row]) -> str:
        values = values_of(rows, name)
        if not len(values):
            return NONE
        return f"{100 * np.mean(values <= CLOSE):.0f} % / {np.exp(np.log(values).mean()):.2f}"

    return cell


_COLUMNS: Sequence[Column] = (
    ("sets", lambda rows: str(len(rows))),
    ("wholly right %", _percent("right")),
    ("right or said %", _percent("right", "said", "refused")),
    ("refused %", _percent("refused")),
    ("bad found %", _per_contact("found", "bad")),
    ("sound doubted %", _per_contact("false", "contacts")),
    *((f"{name}, judged", _ratios(name)) for name in ("blend", "gpis")),
    *((f"{name}, believed", _ratios(f"{name}_raw")) for name in ("blend", "gpis")),
    ("within 1.96 sd %", mean_cell("blend_within", 100.0, 0)),
)
