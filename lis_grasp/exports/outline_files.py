"""Outlines as DXF and SVG files in millimetres, for laser cutters and CAD."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exports.outline import Outline, rings_of
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.typing import FloatArray

_MM = 1e3  # in a metre
_MARGIN = 2.0  # around a drawing [mm]

# Colour of each layer: by the colour index of AutoCAD, and in SVG.
_COLOURS: Mapping[str, tuple[int, str]] = {
    "outer": (1, "#d62728"),
    "outline": (7, "#000000"),
    "inner": (5, "#1f77b4"),
}

FORMATS: tuple[str, ...] = (".dxf", ".svg")
"""Endings of files that `save_outline` writes."""


def save_outline(outline: Outline, path: Path | str) -> None:
    """Write an outline and both bounds to a DXF (R12) or SVG file in millimetres.

    Layers, in SVG groups, are `outer`, the cut-out, `outline` and `inner`. In SVG y points down:
    the drawing is turned so that it looks as in DXF. Equal outlines make equal bytes.

    Raises `InvalidOptionError` for another ending, `InvalidFileError` if the file cannot be
    written.

    Examples
    --------
    >>> save_outline(outline(shapes.find("box").mesh), "box.dxf")
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InvalidOptionError.not_one_of("ending", path.suffix, FORMATS)
    layers = {
        "outer": rings_of(outline.outer),
        "outline": rings_of(outline.polygon),
        "inner": rings_of(outline.inner),
    }
    scaled = {name: [_MM * ring for ring in rings] for name, rings in layers.items()}
    write_text(path, _dxf(scaled) if path.suffix.lower() == ".dxf" else _svg(scaled))


def _dxf(layers: Mapping[str, list[FloatArray]]) -> str:
    """Return closed polylines of R12, which has no handles and no dates."""
    pairs: list[tuple[int, object]] = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER")]
    pairs += [(1, "AC1009"), (9, "$INSUNITS"), (70, 4), (0, "ENDSEC")]
    pairs += [(0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(layers))]
    for name in layers:
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, _COLOURS[name][0]), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for name, rings in layers.items():
        for ring in rings:
            pairs += [(0, "POLYLINE"), (8, name), (66, 1), (70, 1)]
            for x, y in ring:
                pairs += [(0, "VERTEX"), (8, name), (10, f"{x:.6f}"), (20, f"{y:.6f}")]
            pairs += [(0, "SEQEND"), (8, name)]
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code}\n{value}\n" for code, value in pairs)


def _svg(layers: Mapping[str, list[FloatArray]]) -> str:
    """Return paths in groups; y is turned, as it points down in SVG."""
    points = np.concatenate([ring for rings in layers.values() for ring in rings])
    low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    width, height = high - low
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.6f}mm" height="{height:.6f}mm"'
        f' viewBox="{low[0]:.6f} {-high[1]:.6f} {width:.6f} {height:.6f}">'
    ]
    for name, rings in layers.items():
        path = " ".join(
            "M " + " L ".join(f"{x:.6f} {-y:.6f}" for x, y in ring) + " Z" for ring in rings
        )
        style = f'fill="none" stroke="{_COLOURS[name][1]}" stroke-width="0.1"'
        lines.append(f'<g id="{name}" {style}><path fill-rule="evenodd" d="{path}"/></g>')
    return "\n".join([*lines, "</svg>", ""])
