"""Contacts that lie: what is found, put right and refused, on objects that fitted no constant.

    python benchmarks/bench_lies.py results/lies --part 3
    python benchmarks/bench_lies.py results/new --part 3 --shapes others
    python benchmarks/bench_lies.py results/lies --part 12 --fits

Sets of contacts of the evaluation shapes (`lis_grasp_studies.contact_study.lies`), or of long, flat
and hard objects on which nothing was chosen either, with lies of each kind; the noise is not given.
Main sets have at least 20 contacts and at most 0.5 mm and 3 degrees of noise; hard ones are few or
have 3 mm and 15 degrees. Errors (--fits) are the larger of the two rms distances between estimate
and truth, over that of the true contacts, both at least 0.2 % of the size: the percentage of ratios
up to 1.15, and their geometric mean.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from lis_grasp import BlendedImplicitSurface, Contacts, extract_mesh
from lis_grasp.io.json_lines import Row
from lis_grasp.surfaces import judge_contacts
from lis_grasp_studies.contact_study.contact_sets import ContactCase, contact_set
from lis_grasp_studies.contact_study.lies import DRAWS, EXPERIMENT, HARD, LIES, LieTrial
from lis_grasp_studies.figures._solids import VIEW
from lis_grasp_studies.figures.static_scene import draw_still
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, split, values_of, where, write_tables
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT, EVALUATION, FAMILIES, LONG, TOOLS
from lis_grasp_studies.test_objects.shape_sets import HARD as OBJECTS

CLOSE = 1.15
FITTED = ("clean", "one flip", "10 % flips", "one wrong normal")
FITTED += ("stray at 0.5 sizes", "stray at 1 size", "empty row")
BAD_COLOUR = "#8e44ad"
SHAPES = {
    "development": [name for family in DEVELOPMENT.values() for name in family],
    "evaluation": [name for family in EVALUATION.values() for name in family],
}
# Constants were chosen on another paddle and another washer.
SEEN = {*SHAPES["development"], *SHAPES["evaluation"], "paddle", "washer"}
SHAPES["others"] = [name for name in (*LONG, *OBJECTS, *TOOLS) if name not in SEEN]


def rate(rows: Sequence[Row], *columns: str) -> float:
    """Return the percentage of rows in which one of some columns is true."""
    return 100.0 * float(np.mean([any(row.get(name) for name in columns) for row in rows]))


def percent(*columns: str) -> Callable[[Sequence[Row]], str]:
    return lambda rows: f"{rate(rows, *columns):.1f}"


def per_contact(part: str, whole: str) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        total = values_of(rows, whole).sum()
        return f"{100.0 * values_of(rows, part).sum() / total:.2f}" if total else "-"

    return cell


def ratios(name: str) -> Callable[[Sequence[Row]], str]:
    """Return a cell with the rate of ratios up to 1.15, and their geometric mean."""

    def cell(rows: Sequence[Row]) -> str:
        values = values_of(rows, name)
        if not len(values):
            return "-"
        return f"{100 * np.mean(values <= CLOSE):.0f} % / {np.exp(np.log(values).mean()):.2f}"

    return cell


COLUMNS = (
    ("sets", lambda rows: str(len(rows))),
    ("wholly right %", percent("right")),
    ("right or said %", percent("right", "said", "refused")),
    ("refused %", percent("refused")),
    ("bad found %", per_contact("found", "bad")),
    ("sound doubted %", per_contact("false", "contacts")),
    *((f"{name}, judged", ratios(name)) for name in ("blend", "gpis")),
    *((f"{name}, believed", ratios(f"{name}_raw")) for name in ("blend", "gpis")),
    ("within 1.96 sd %", lambda rows: f"{100 * values_of(rows, 'blend_within').mean():.0f}"
     if len(values_of(rows, "blend_within")) else "-"),
)  # fmt: skip


def draw(path: Path) -> None:
    """Draw the estimate of contacts with a flip and a stray, believed and judged."""
    true = contact_set("mallet", ContactCase("even", 60), 3).exact
    normals = true.normals.copy()
    normals[[8, 31]] *= -1.0
    points = np.vstack([true.points, true.points.mean(axis=0) + [0.03, -0.06, 0.14]])
    told = Contacts(points, np.vstack([normals, [0.0, 0.0, 1.0]]))
    bad = judge_contacts(told).bad
    figure, axes = plt.subplots(1, 2, figsize=(7.16, 2.6), layout="constrained")
    for axis, contacts in zip(axes, (replace(told, judged=True), told), strict=True):
        mesh = extract_mesh(BlendedImplicitSurface.from_contacts(contacts))
        mesh.vertex_attributes.clear()
        draw_still(axis, estimate=mesh, contacts=told.subset(~bad))
        factor = 0.2 / float(mesh.extents.max())
        places, _ = VIEW.project(factor * told.points[bad])
        tips, _ = VIEW.project(factor * (told.points + 0.025 * told.normals)[bad])
        axis.plot(*np.stack([places, tips]).transpose(2, 0, 1), color=BAD_COLOUR, zorder=9)
        axis.scatter(*places.T, s=30, color=BAD_COLOUR, zorder=10)
        axis.set_title("believed" if contacts.judged else "two turned, one left out")
    figure.savefig(path, dpi=110)


def main() -> None:
    options = read_options(
        __doc__, folder=Path, seed=2028, fits=False, part=1, shapes="evaluation", jobs=1, picture=""
    )
    if options.picture:
        draw(Path(options.picture))
        return
    names = SHAPES[options.shapes]
    trials = [
        LieTrial(name, *draw, options.seed, int(options.fits))
        for i, name in enumerate(names)
        for j, draw in enumerate(DRAWS)
        if (i + j) % options.part == 0 and not (options.fits and draw in HARD)
    ]
    options.folder.mkdir(parents=True, exist_ok=True)
    file = options.folder / ("fits.jsonl" if options.fits else "verdicts.jsonl")
    kinds_of_lies = FITTED if options.fits else list(LIES)
    rows = EXPERIMENT.complete(trials, kinds_of_lies, file, jobs=options.jobs)
    hard = {(draw[1], draw[2]) for draw in HARD}
    main_rows = [row for row in rows if (row["count"], row["millimetres"]) not in hard]
    kinds = {kind: where(main_rows, lie=kind) for kind in LIES}
    tables = [grouped_table("by_lie", "By kind of lie", "lie", kinds, COLUMNS)]
    others = [row for row in rows if (row["count"], row["millimetres"]) in hard]
    groups = {kind: where(others, lie=kind) for kind in LIES}
    tables.append(grouped_table("hard", "Few or noisy contacts", "lie", groups, COLUMNS))
    by_family = {
        (family, kind): where(main_rows, family=family, lie=kind)
        for family in FAMILIES
        for kind in LIES
    }
    title = "By family of shapes"
    tables.append(grouped_table("by_family", title, "family | lie", by_family, COLUMNS[:6]))
    draws = split(where(rows, lie="clean"), "draw", "count", "millimetres")
    title = "Clean sets by draw, number and noise [mm]"
    tables.append(grouped_table("clean", title, "draw | number | noise", draws, COLUMNS[:6]))
    write_tables(options.folder, tables)
    for table in tables:
        print(f"\n{table.title}\n\n{table.markdown()}")


if __name__ == "__main__":
    main()
