"""The paper's claims and our own, each beside what the trials say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.experiments.paper.exactness import cube_edge_error, meshing_loss
from lis_grasp.experiments.paper.summary import Table, tabulate
from lis_grasp.experiments.paper.wedge import NOISE_LEVELS
from lis_grasp.io.json_lines import Row

# Cells of the meshes whose loss at edges is measured [m].
_COARSE = 0.008

EDGE, TO_TRUTH, TO_ESTIMATE = "edge_rmsd", "rmsd", "rmsd_truth_to_estimate"

# A share counts as the paper's if it is within this of it.
_ALIKE = 0.10


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement, what was claimed, and what was measured.

    Parameters
    ----------
    statement
        In plain words.
    claimed
        The number claimed.
    measured
        The number here, with its interval.
    verdict
        One word or two.
    """

    statement: str
    claimed: str
    measured: str
    verdict: str


def paper_claims(rows: Sequence[Row]) -> list[Claim]:
    """Return the claims of Ottenhaus et al. 2016 beside LIS and GPIS as measured here."""
    edge, to_truth, to_estimate = (
        tabulate(rows, "whole", measure) for measure in (EDGE, TO_TRUTH, TO_ESTIMATE)
    )
    claims = [
        _reduction("LIS is below GPIS at edges (fig. 10)", 0.59, edge),
        _similar("LIS and GPIS are alike overall (fig. 9), estimate to truth", to_truth),
        _similar("the same, truth to estimate", to_estimate),
        _reduction(
            "LIS is below GPIS on the box (fig. 9), truth to estimate",
            0.30,
            _only(to_estimate, "box"),
        ),
    ]
    for name in ("cylinder", "mallet"):
        share, low, high = _only(to_estimate, name).reduction("lis", "gpis")
        claims.append(
            Claim(
                f"GPIS is slightly better on the {name} (fig. 9), truth to estimate",
                "LIS above",
                f"LIS {_signed(share)} ({_signed(high)} to {_signed(low)})",
                "reproduces" if low < share < 0.0 else "does not",
            )
        )
    return claims + _noise_claims(rows)


def our_claims(rows: Sequence[Row], estimator: str) -> list[Claim]:
    """Return by how much our estimator is below GPIS in every experiment, and where it is not."""
    claims = []
    for experiment, measure, text, goal in (
        ("whole", EDGE, "fully explored, edges", 0.80),
        ("whole", TO_ESTIMATE, "fully explored, truth to estimate", 0.48),
        ("whole", TO_TRUTH, "fully explored, estimate to truth", 0.33),
        ("half", EDGE, "half explored, edges", 0.60),
        ("half", TO_ESTIMATE, "half explored, truth to estimate", 0.0),
        ("half", TO_TRUTH, "half explored, estimate to truth", 0.0),
        ("few", TO_ESTIMATE, "5 to 8 contacts, truth to estimate", 0.0),
        ("few", TO_TRUTH, "5 to 8 contacts, estimate to truth", 0.0),
        ("noisy", EDGE, "1 mm and 3 degrees of noise, edges", 0.50),
        ("noisy", TO_ESTIMATE, "1 mm and 3 degrees of noise, truth to estimate", 0.25),
        ("noisy", TO_TRUTH, "1 mm and 3 degrees of noise, estimate to truth", 0.25),
    ):
        table = tabulate(rows, experiment, measure)
        if estimator in table.estimators and "gpis" in table.estimators:
            claims.append(_goal(text, goal, table, estimator))
    for level, measure, goal in (
        (2, EDGE, 0.65),
        (2, TO_ESTIMATE, 0.40),
        (len(NOISE_LEVELS) - 1, EDGE, 0.0),
        (len(NOISE_LEVELS) - 1, TO_ESTIMATE, 0.0),
    ):
        table = tabulate(rows, "wedge", measure)
        if {estimator, "gpis"} <= set(table.estimators) and str(level) in table.objects:
            where = "edge" if measure == EDGE else "truth to estimate"
            text = f"12 contacts round an edge, {_noise(level)}, {where}"
            claims.append(_goal(text, goal, _only(table, str(level)), estimator))
    for measure, text in ((TO_ESTIMATE, "truth to estimate"), (TO_TRUTH, "estimate to truth")):
        table = tabulate(rows, "whole", measure)
        if {estimator, "gpis"} <= set(table.estimators):
            ratios = table.per_object(estimator) / table.per_object("gpis")
            worst = int(np.nanargmax(ratios))
            claims.append(
                Claim(
                    f"the worst single object, fully explored, {text}",
                    "at most 1.05 of GPIS",
                    f"{ratios[worst]:.2f} ({table.objects[worst]})",
                    _met(bool(ratios[worst] <= 1.05)),
                )
            )
    return claims


def exact_claims(estimator: str) -> list[Claim]:
    """Return how nearly what should be exact is: measured now, no trials needed."""
    cube, loss = cube_edge_error(estimator), meshing_loss(_COARSE)
    return [
        Claim(
            "a cube from six contacts, at its edges",
            "below 0.01 mm",
            f"{1e3 * cube:.4f} mm",
            _met(cube < 1e-5),
        ),
        Claim(
            f"what meshing with cells of {1e3 * _COARSE:g} mm loses at edges of exact estimates",
            "below 0.1 mm",
            f"{1e3 * loss:.4f} mm",
            _met(loss < 1e-4),
        ),
    ]


def _noise_claims(rows: Sequence[Row]) -> list[Claim]:
    table = tabulate(rows, "wedge", EDGE)
    claims = []
    for level, said in ((2, "notably better"), (len(NOISE_LEVELS) - 1, "similar")):
        if {"lis", "gpis"} <= set(table.estimators) and str(level) in table.objects:
            share, low, high = _only(table, str(level)).reduction("lis", "gpis")
            alike = abs(share) <= 2 * _ALIKE
            claims.append(
                Claim(
                    f"LIS against GPIS at an edge under {_noise(level)} (fig. 12)",
                    said,
                    f"LIS {_signed(share)} ({_signed(high)} to {_signed(low)})",
                    "reproduces" if (said == "similar") == alike and share > -0.2 else "does not",
                )
            )
    return claims


def _reduction(statement: str, claimed: float, table: Table) -> Claim:
    share, low, high = table.reduction("lis", "gpis")
    return Claim(
        statement,
        f"{100 * claimed:.0f} % below",
        f"{_signed(share)} ({_signed(high)} to {_signed(low)})",
        "reproduces" if share >= claimed - _ALIKE else "does not",
    )


def _similar(statement: str, table: Table) -> Claim:
    share, low, high = table.reduction("lis", "gpis")
    return Claim(
        statement,
        "similar",
        f"LIS {_signed(share)} ({_signed(high)} to {_signed(low)})",
        "reproduces" if abs(share) <= 2 * _ALIKE else "does not",
    )


def _goal(text: str, goal: float, table: Table, estimator: str) -> Claim:
    share, low, high = table.reduction(estimator, "gpis")
    claimed = f"at least {100 * goal:.0f} % below GPIS" if goal else "not above GPIS"
    measured = f"{_signed(share)} ({_signed(high)} to {_signed(low)})"
    return Claim(text, claimed, measured, _met(share >= goal))


def _only(table: Table, name: str) -> Table:
    index = table.objects.index(name)
    return Table(table.estimators, (name,), table.seeds, table.values[:, index : index + 1])


def _signed(reduction: float) -> str:
    """Return a reduction as the change it is: 0.59 as -59 %."""
    return f"{-100 * reduction:+.0f} %".replace("-", "\N{MINUS SIGN}")


def _noise(level: int) -> str:
    noise = NOISE_LEVELS[level]
    return f"{1e3 * noise.position:.0f} mm and {np.degrees(noise.normal):.0f} degrees of noise"


def _met(holds: bool) -> str:
    return "met" if holds else "missed"
