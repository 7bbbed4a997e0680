"""Figures of the paper's experiments, drawn by matplotlib without a display.

Each figure of the paper (Ottenhaus et al. 2016) that needs no results of trials is a function of
seeds; `FIGURES` has them by number. Figs. 9, 10 and 12 are charts of results, which `bars`,
`curve_panels` and `calibration` draw from plain numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from matplotlib.figure import Figure

from lis_grasp.io.yaml_files import read_yaml
from lis_grasp.visualization.camera import View
from lis_grasp_studies.figures._convexity import figure_4, figure_5
from lis_grasp_studies.figures._errors import figure_8, figure_11
from lis_grasp_studies.figures._objects import bad_contacts, figure_6, figure_7, patch_map
from lis_grasp_studies.figures._planar import figure_1, figure_2
from lis_grasp_studies.figures.charts import bars, calibration, curve_panels
from lis_grasp_studies.figures.palette import estimator_colour, estimator_label
from lis_grasp_studies.figures.static_scene import draw_still
from lis_grasp_studies.figures.style import png_of


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure of the paper: its title, its caption, and the function that draws it."""

    title: str
    caption: str
    draw: Callable[..., Figure]


_CAPTIONS = read_yaml(Path(__file__).with_name("captions.yaml"))
_DRAWN = {
    1: figure_1,
    2: figure_2,
    4: figure_4,
    5: figure_5,
    6: figure_6,
    7: figure_7,
    8: figure_8,
    11: figure_11,
}

FIGURES: Mapping[int, PaperFigure] = MappingProxyType(
    {number: PaperFigure(**_CAPTIONS[number], draw=draw) for number, draw in _DRAWN.items()}
)
"""The figures that need no results of trials, by their numbers in the paper, in order."""

CHART_CAPTIONS: Mapping[int, str] = MappingProxyType(
    {number: text["caption"] for number, text in _CAPTIONS.items() if number not in _DRAWN}
)
"""Captions of the charts of results, by their numbers in the paper."""

__all__ = [
    "CHART_CAPTIONS",
    "FIGURES",
    "PaperFigure",
    "View",
    "bad_contacts",
    "bars",
    "calibration",
    "curve_panels",
    "draw_still",
    "estimator_colour",
    "estimator_label",
    "patch_map",
    "png_of",
]
