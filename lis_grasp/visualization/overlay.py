"""The overlay of the page: title, summary, legend, layers and the controls of the lift."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from lis_grasp.visualization.canvas import Layer
from lis_grasp.visualization.colours import VIRIDIS, ColourScale


def build_overlay(
    title: str,
    summary: Sequence[str],
    *,
    layers: Sequence[Layer],
    scale: ColourScale | None,
    grid: float,
    duration: float,
) -> str:
    """Return the overlay's HTML; every text in it is escaped.

    Parameters
    ----------
    scale
        Colours of the estimate's uncertainty, or None for no legend.
    grid
        Spacing of the table's grid [m].
    duration
        Duration of the lift [s]; 0 for none.
    """
    objects = [layer for layer in layers if not _is_grasp(layer) and layer.identity != "lift"]
    grasps = [layer for layer in layers if _is_grasp(layer)]
    lift = [layer for layer in layers if layer.identity == "lift"]
    lines = "".join(f"<p>{escape(line)}</p>" for line in summary)
    parts = [
        '<details id="panel" open>',
        f"<summary><h1>{escape(title)}</h1></summary>",
        '<div class="content">',
        f'<div class="lines">{lines}</div>' if lines else "",
        f'<ul class="layers">{"".join(_row(layer, scale) for layer in objects + lift)}</ul>',
        _legend(scale) if scale is not None else "",
        f'<h2>Grasps</h2><ul class="layers">{"".join(_row(g, None) for g in grasps)}</ul>'
        if grasps
        else "",
        f'<p class="fine">Grid {_millimetres(grid)}. Drag to turn, wheel or pinch to zoom,'
        " right button or two fingers to move.</p>",
        "</div>",
        "</details>",
        _player(duration) if duration > 0.0 else "",
        '<p id="trouble" role="alert" hidden></p>',
        '<noscript><p id="noscript">This scene is drawn by JavaScript, which is switched off.</p>'
        "</noscript>",
    ]
    return "\n".join(part for part in parts if part)


def _is_grasp(layer: Layer) -> bool:
    return layer.identity.startswith("grasp-")


def _row(layer: Layer, scale: ColourScale | None) -> str:
    checked = " checked" if layer.on else ""
    paint = layer.colour
    if layer.identity == "estimate" and scale is not None:
        paint = f"linear-gradient(90deg,{','.join(VIRIDIS)})"
    note = f"<small>{escape(layer.note)}</small>" if layer.note else ""
    hint = f' title="{escape(layer.detail)}"' if layer.detail else ""
    kind = layer.identity.split("-")[0]
    return (
        f'<li{hint}><label><input type="checkbox" data-layer="{escape(layer.identity)}"{checked}>'
        f'<i class="swatch {kind}" style="background:{paint}"></i>'
        f"<span>{escape(layer.label)}{note}</span></label></li>"
    )


def _legend(scale: ColourScale) -> str:
    labels = "".join(f"<span>{escape(label)}</span>" for label in scale.tick_labels())
    return (
        '<div class="legend"><h2>Uncertainty of the surface</h2>'
        f'<div class="bar" style="background:linear-gradient(90deg,{",".join(VIRIDIS)})"></div>'
        f'<div class="ticks">{labels}</div>'
        '<div class="ends"><span>well supported by touches</span><span>guessed</span></div></div>'
    )


def _player(duration: float) -> str:
    return (
        '<div id="player"><button id="play" type="button" aria-label="Play the lift"></button>'
        f'<input id="time" type="range" min="0" max="{duration:.6f}" step="any" value="0"'
        ' aria-label="Time of the lift">'
        f'<output id="clock" for="time">0.00 / {duration:.2f} s</output></div>'
    )


def _millimetres(length: float) -> str:
    return f"{length * 1e3:.3g} mm" if length < 0.01 else f"{length * 1e2:.3g} cm"
