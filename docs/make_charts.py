"""Draw the charts of the results page, and print its rates, from the published rows.

    python docs/make_charts.py

Needs the extra `study`, whose pyarrow reads the rows.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pandas as pd

from lis_grasp.shapes import NAMES
from lis_grasp_studies.figures.palette import estimator_colour, estimator_label
from lis_grasp_studies.test_objects.shape_sets import EVALUATION, TOOLS
from lis_grasp_studies.unknown_study.definition import SCANS

_HERE = Path(__file__).resolve().parent
ESTIMATORS = ("truth", "blend", "gpis", "lis")


def read_rows() -> pd.DataFrame:
    """Return one row a trial of the study of unknown objects."""
    return pd.read_parquet(_HERE / "study" / "rows.parquet")


def held_rates(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the held rate [%] of each estimator and number of touches, with all touches last."""
    rates = rows.pivot_table("held", "estimator", "touches")
    rates["all"] = rows.groupby("estimator")["held"].mean()
    return 100 * rates.loc[list(ESTIMATORS)].astype(float)


def family_rates(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the held rate [%] of each family of objects and estimator."""
    families = {name: family for family, names in EVALUATION.items() for name in names}
    families |= dict.fromkeys(NAMES, "built-in") | dict.fromkeys(SCANS, "scans")
    families |= dict.fromkeys(TOOLS, "tools")
    family = rows["object"].map(families)
    return 100 * rows.assign(family=family).pivot_table("held", "family", "estimator").astype(float)


def main() -> None:
    """Write the chart of held grasps and print both tables."""
    rows = read_rows()
    rates = held_rates(rows)
    print(rates.round(0), family_rates(rows).round(0), sep="\n\n")
    figure, axes = plt.subplots(figsize=(7.16, 2.6), layout="constrained")
    width = 0.2
    columns = list(rates.columns)
    for k, name in enumerate(ESTIMATORS):
        places = [position + (k - 1.5) * width for position in range(len(columns))]
        bars = axes.bar(
            places,
            rates.loc[name],
            width,
            color=estimator_colour(name),
            label=estimator_label(name),
        )
        axes.bar_label(bars, fmt="%.0f", fontsize=8)
    axes.set_xticks(
        range(len(columns)), [f"{name} touches" for name in columns[:-1]] + ["all trials"]
    )
    axes.set(ylim=(0, 112), ylabel="held [%]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(ncols=4, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 1.2), fontsize=9)
    figure.savefig(_HERE / "images" / "held.png", dpi=200)


if __name__ == "__main__":
    main()
