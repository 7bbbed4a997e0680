"""Claims of the paper (Ottenhaus et al. 2016), beside the values measured here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.experiments.paper.wedge import NOISE_LEVELS
from lis_grasp.experiments.statistics import MeasureTable, measure_table
from lis_grasp.io.json_lines import Row

# A measured reduction agrees with the paper's within this; two errors are similar within twice it.
_ALIKE = 0.10


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper, its value, the value measured here, and whether they agree."""

    statement: str
    claimed: str
    measured: str
    verdict: str


def paper_claims(rows: Sequence[Row]) -> list[Claim]:
    """Return the claims of Ottenhaus et al. 2016 beside LIS and GPIS as measured here.

    Verdicts are "reproduced" or "not reproduced".
    """
    edge, to_truth, to_estimate = (
        experiment_table(rows, "whole", measure)
        for measure in ("edge_rmsd", "rmsd", "rmsd_truth_to_estimate")
    )
    claims = [
        _reduced("LIS is below GPIS at edges (fig. 10)", 0.59, edge),
        _similar("LIS and GPIS are alike overall (fig. 9), estimate to truth", to_truth),
        _similar("the same, truth to estimate", to_estimate),
        _reduced(
            "LIS is below GPIS on the box (fig. 9), truth to estimate",
            0.30,
            to_estimate.only("box"),
        ),
    ]
    for name in ("cylinder", "mallet"):
        table = to_estimate.only(name)
        reduction, low, _ = table.reduction("lis", "gpis")
        statement = f"GPIS is slightly better on the {name} (fig. 9), truth to estimate"
        claims.append(_claim(statement, "LIS above", table, low < reduction < 0.0))
    wedge = experiment_table(rows, "wedge", "edge_rmsd")
    for level, claimed in ((2, "notably better"), (len(NOISE_LEVELS) - 1, "similar")):
        if str(level) in wedge.objects:
            table = wedge.only(str(level))
            reduction = table.reduction("lis", "gpis")[0]
            alike = abs(reduction) <= 2 * _ALIKE
            agrees = (claimed == "similar") == alike and reduction > -0.2
            statement = f"LIS against GPIS at an edge under {noise_label(level)} (fig. 12)"
            claims.append(_claim(statement, claimed, table, agrees))
    return claims


def experiment_table(rows: Sequence[Row], experiment: str, measure: str) -> MeasureTable:
    """Return one measure of one experiment."""
    return measure_table([row for row in rows if row["experiment"] == experiment], measure)


def change_text(table: MeasureTable, estimator: str) -> str:
    """Return the change of the mean from GPIS, with its interval: −59 % (−62 % to −55 %)."""
    reduction, low, high = table.reduction(estimator, "gpis")
    text = f"{-100 * reduction:+.0f} % ({-100 * high:+.0f} % to {-100 * low:+.0f} %)"
    return text.replace("-", "\N{MINUS SIGN}")


def noise_label(level: int) -> str:
    """Return the name of a level of noise of the wedge."""
    noise = NOISE_LEVELS[level]
    return f"{1e3 * noise.position:.0f} mm and {np.degrees(noise.normal):.0f} degrees of noise"


def _reduced(statement: str, claimed: float, table: MeasureTable) -> Claim:
    agrees = table.reduction("lis", "gpis")[0] >= claimed - _ALIKE
    return _claim(statement, f"{100 * claimed:.0f} % below", table, agrees)


def _similar(statement: str, table: MeasureTable) -> Claim:
    return _claim(statement, "similar", table, abs(table.reduction("lis", "gpis")[0]) <= 2 * _ALIKE)


def _claim(statement: str, claimed: str, table: MeasureTable, agrees: bool) -> Claim:
    verdict = "reproduced" if agrees else "not reproduced"
    return Claim(statement, claimed, f"LIS {change_text(table, 'lis')}", verdict)
