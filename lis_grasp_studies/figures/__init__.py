"""Figures of the paper's experiments, drawn by matplotlib without a display.

Each figure of the paper (Ottenhaus et al. 2016) that needs no results of trials is a function of
seeds; `FIGURES` has them by number. Figs. 9, 10 and 12 are charts of results, which `bars`,
`curve_panels` and `calibration` draw from plain numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from matplotlib.figure import Figure

from lis_grasp_studies.figures.charts import bars, calibration, curve_panels
from lis_grasp_studies.figures.convexity_figures import figure_4, figure_5
from lis_grasp_studies.figures.error_figures import figure_8, figure_11
from lis_grasp_studies.figures.object_figures import figure_6, figure_7, patch_map
from lis_grasp_studies.figures.painter import View
from lis_grasp_studies.figures.palette import estimator_colour, estimator_label
from lis_grasp_studies.figures.planar_figures import figure_1, figure_2
from lis_grasp_studies.figures.static_scene import draw_still
from lis_grasp_studies.figures.style import png_of


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure of the paper: its title, its caption, and the function that draws it."""

    title: str
    caption: str
    draw: Callable[..., Figure]


FIGURES: Mapping[int, PaperFigure] = MappingProxyType(
    {
        1: PaperFigure(
            "Contacts with orthogonal normals",
            "Top: two contacts and the estimated implicit shape potential f at z = 0, violet inside"
            " and orange outside; the thick line is the surface, f = 0. Bottom: a cube of 10 cm,"
            " touched in the middle of each face. GPIS rounds corners and closes behind the"
            " contacts; LIS and blend keep corners sharp and extrapolate where there is no contact."
            " LIS scales f by β, so its values inside are small.",
            figure_1,
        ),
        2: PaperFigure(
            "Local convexity at corners",
            "LIS on three contacts of a step (true outline dashed, section at z = 0). Without β"
            " the surface overshoots both corners. Circles show β* towards each direction: blue is"
            " convex, red concave. With the corrected sign (middle) the overshoot almost vanishes;"
            " with eq. 10 as published (right) it grows. The kernel is 0.3 of the contacts' spacing"
            " wide, instead of 0.2, to show the effect clearly; the paper gives no width.",
            figure_2,
        ),
        4: PaperFigure(
            "Angular kernel",
            "Weight of a neighbour towards a direction at angle φ from its own (eq. 11). The width"
            " σ_w falls with the neighbour's height above or below the contact's plane (eq. 13),"
            " the height σ_h with its distance (eq. 12).",
            figure_4,
        ),
        5: PaperFigure(
            "Local convexity of every contact",
            "Each contact of two fully explored objects with its β* towards each direction of its"
            " tangent plane: blue is convex, red concave, white flat. Narrow blue wedges in the"
            " bore point at contacts on the other side of the wall, which LIS cannot distinguish"
            " from the same side. The kernel is as wide as in figure 2.",
            figure_5,
        ),
        6: PaperFigure(
            "Objects",
            "The eight objects, 20 cm in their largest extent, all at one scale, sharp edges dark."
            " The paper gives no other proportions: these are ours. Sphere and torus have no edge.",
            figure_6,
        ),
        7: PaperFigure(
            "Explored region",
            "A half-explored object from two opposite sides. Yellow is within 50 mm of a contact"
            " and counts as explored, red does not.",
            figure_7,
        ),
        8: PaperFigure(
            "One exploration",
            "Estimates of the half cylinder from the same contacts during its exploration: grey"
            " where explored, cream beyond, where errors are not measured. Lines connect the true"
            " edges with the nearest point of the estimate, at true scale, from green (small) to"
            " red (large); the number is their root mean square. Hidden lines are faint; unexplored"
            " true edges are thin and grey. The error at edges does not measure the overshoot of"
            " LIS beside them; fig. 9 does.",
            figure_8,
        ),
        11: PaperFigure(
            "Errors at edges, fully explored",
            "The six objects that have edges, drawn as in figure 8, from all contacts of one walk"
            " each. The distance from an edge is 0 where a surface passes through it, even if the"
            " surface then extends beyond the object.",
            figure_11,
        ),
    }
)
"""The figures that need no results of trials, by their numbers in the paper, in order."""

CHART_CAPTIONS: Mapping[int, str] = MappingProxyType(
    {
        9: "Root mean square deviation of the surface in the explored region of fully explored"
        " objects: bars are means over seeds, lines one standard deviation, dots single seeds;"
        " numbers are means over objects.",
        10: "Root mean square distance from the explored true edges to the estimate, drawn as in"
        " figure 9; objects without edges are missing.",
        12: "Twelve contacts round a 90 degree edge under growing noise of positions and normals:"
        " mean error over seeds, the band is one standard deviation. Estimators that accept a noise"
        " level are given it.",
    }
)
"""Captions of the charts of results, by their numbers in the paper."""

__all__ = [
    "CHART_CAPTIONS",
    "FIGURES",
    "PaperFigure",
    "View",
    "bars",
    "calibration",
    "curve_panels",
    "draw_still",
    "estimator_colour",
    "estimator_label",
    "patch_map",
    "png_of",
]
