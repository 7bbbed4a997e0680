"""Small pictures of oriented points as SVG, for notebooks."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray

# Width and height of a picture, its margin, and the length of a normal [CSS pixels].
_SIZE, _MARGIN, _ARROW = (240.0, 180.0), 18.0, 12.0
_MOST_POINTS = 400
# Right and up of a picture, in a view from the front, the right and above.
_VIEW = np.array([[0.82, 0.57, 0.0], [-0.23, 0.33, 0.91]])
_DOWN = np.array([1.0, -1.0])  # the vertical axis of SVG points down


def points_svg(points: FloatArray, normals: FloatArray) -> str:
    """Return an SVG picture of points (N, 3) [m] with normals (N, 3); empty without any.

    At most 400 are drawn. Farther points are drawn first, and paler.
    """
    if not len(points):
        return ""
    rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MOST_POINTS)).astype(int))
    flat, depth = points[rows] @ _VIEW.T, points[rows] @ np.cross(*_VIEW)  # (P, 2), (P,)
    low, high = flat.min(axis=0), flat.max(axis=0)
    scale = np.min((np.array(_SIZE) - 2.0 * _MARGIN) / np.maximum(high - low, 1e-9))
    places = 0.5 * np.array(_SIZE) + _DOWN * (flat - 0.5 * (low + high)) * scale
    arrows = _DOWN * (normals[rows] @ _VIEW.T) * _ARROW
    near = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    drawn = [
        f'<g opacity="{0.45 + 0.55 * near[k]:.2f}"><path d="M{x:.1f} {y:.1f}l{u:.1f} {v:.1f}"'
        f' stroke="#f2912c"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="#e5484d"/></g>'
        for k in np.argsort(depth)
        for x, y, u, v in [(*places[k], *arrows[k])]
    ]
    width, height = _SIZE
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}"'
        f' role="img">{"".join(drawn)}</svg>'
    )
