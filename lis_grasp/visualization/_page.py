"""Self-contained HTML page: meshcat's viewer, drawing commands, and the overlay's texts."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from lis_grasp.typing import FloatArray
from lis_grasp.visualization._drawing import Canvas, Layer
from lis_grasp.visualization._story import Story
from lis_grasp.visualization.camera import CameraView
from lis_grasp.visualization.colours import VIRIDIS, ColourScale

_HERE = "lis_grasp.visualization"
# Scripts are in the order of their dependencies.
_SCRIPTS = ("appearance.js", "story.js", "camera.js", "scene.js")

_RAMP = f"linear-gradient(90deg,{','.join(VIRIDIS)})"
_EXPLAINED = {
    "touch": "the contacts are made one by one, and the estimate grows",
    "grasp": "grasps are planned on the estimate",
    "lift": "the best one lifts the true object and shakes it",
}
_MARKS = (
    "Orange: pads, with their axes. Purple: tips of the probe postures. Red, green and blue: x, y"
    " and z of the palm frame H."
)
# Layers in the short legend, which replaces the panel when it is folded.
_KEYED = (
    "truth",
    "contacts",
    "normals",
    "bad",
    "free",
    "seen",
    "guessed",
    "unknown",
    "search",
    "motion",
    "surroundings",
    "free-bodies",
)


@dataclass(frozen=True, slots=True, eq=False)
class PageContent:
    """All that the page's script reads, besides the drawing commands; every page has all of it."""

    story: Story
    camera: CameraView
    grasps: Sequence[Sequence[FloatArray]] = ()  # poses of all links in O, at each grasp
    touches: Sequence[dict[str, Any] | None] = ()  # see `touch_facts`
    postures: Sequence[str] = ()  # captions, if the grasps are postures of a hand alone

    def facts(self) -> dict[str, Any]:
        """Return the content as JSON."""
        postures = {"postures": list(self.postures)} if self.postures else {}
        return {
            "grasps": [[column_major(X) for X in links] for links in self.grasps],
            "touches": list(self.touches),
            "story": {**self.story.facts(), **postures},
            "camera": self.camera.facts(),
        }


def column_major(X: FloatArray) -> list[float]:
    """Return a pose (4, 4) as 16 numbers, column by column, rounded to 0.1 um."""
    return [round(float(v), 7) for v in X.T.ravel()]


def build_page(title: str, canvas: Canvas, *, overlay: str, content: PageContent) -> str:
    """Return a page that draws a canvas with meshcat's viewer, offline.

    `title` is plain text, `overlay` is escaped HTML, the page's script shows `content`.
    The Content Security Policy allows no connection and only the page's own two scripts, so that
    names that look like markup cannot run.
    """
    viewer = _script_text(_viewer())
    script = _script_text("".join(_asset(name) for name in _SCRIPTS))
    style = _asset("scene.css")
    facts = {
        "layers": [
            {"id": layer.identity, "on": layer.on, "colour": layer.colour, "note": layer.note}
            for layer in canvas.layers
        ],
        **content.facts(),
        "lengths": [len(command) for command in canvas.commands],
        "commands": _base64(zlib.compress(b"".join(canvas.commands), 1)),  # higher levels save 3 %
    }
    data = json.dumps(facts, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    digests = [hashlib.sha256(text.encode("utf-8")).digest() for text in (viewer, script)]
    hashes = " ".join(f"'sha256-{_base64(digest)}'" for digest in digests)
    policy = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:;"
        " base-uri 'none'; form-action 'none'"
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>
{style}</style>
</head>
<body>
<div id="meshcat-pane"></div>
{overlay}
<script type="application/json" id="scene-data">{data}</script>
<script>{viewer}</script>
<script>{script}</script>
</body>
</html>
"""


def _asset(name: str) -> str:
    return resources.files(_HERE).joinpath(f"assets/{name}").read_text(encoding="utf-8")


def _viewer() -> str:
    """Return meshcat's viewer with three.js; to import meshcat would load its server."""
    file = distribution("meshcat").locate_file("meshcat/viewer/dist/main.min.js")
    return Path(str(file)).read_text(encoding="utf-8")


def _script_text(source: str) -> str:
    # Only "</script" ends a script element; in a JavaScript string "<\/" equals "</".
    # HTML parsers turn \r\n into \n, which would change the hash of the script.
    return source.replace("\r\n", "\n").replace("</script", "<\\/script")


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def build_overlay(
    title: str,
    summary: Sequence[str],
    *,
    headline: Sequence[tuple[str, str]] = (),
    layers: Sequence[Layer],
    scale: ColourScale | None,
    grid: float,
    story: Story,
    planned: int = 0,
    postures: bool = False,
    picture: bytes | None = None,
) -> str:
    """Return the overlay's HTML, with all text escaped; `picture` is a PNG of what a camera saw.

    The lines of `summary` are folded below the numbers of a `headline`. The layers of grasps show
    the best of the `planned` ones, or postures of a hand if `postures` is set. `scale` colours the
    estimate's uncertainty; `grid` is the spacing of the table's grid [m].
    """
    grasps = [layer for layer in layers if _is_grasp(layer)]
    others = [layer for layer in layers if not _is_grasp(layer)]
    spacing = f"{grid * 1e3:.3g} mm" if grid < 0.01 else f"{grid * 1e2:.3g} cm"
    explained = "; then ".join(_EXPLAINED[chapter.name] for chapter in story.chapters)
    if postures:
        explained = "the hand takes one posture after the other"
    parts = [
        '<details id="panel" open>',
        f"<summary><h1>{escape(title)}</h1></summary>",
        '<div class="content">',
        _results(headline, summary),
        f'<ul class="layers">{"".join(_row(layer, scale) for layer in others)}</ul>',
        _listed_grasps(grasps, planned=planned, postures=postures),
        _figure(picture),
        f'<p class="explained">In this order: {explained}.</p>' if explained else "",
        f'<p class="fine">Grid {spacing}. Drag to turn, wheel or pinch to zoom,'
        " right button or two fingers to move.</p>",
        "</div>",
        "</details>",
        f'<div id="dock">{_legend(layers, scale)}{_player(story)}</div>',
        '<p id="trouble" role="alert" hidden></p>',
        '<noscript><p id="noscript">This scene needs JavaScript, which is switched off.</p>'
        "</noscript>",
    ]
    return "\n".join(part for part in parts if part)


def _results(headline: Sequence[tuple[str, str]], summary: Sequence[str]) -> str:
    """Return the most important numbers, with the lines of the summary folded below them."""
    # A page is of Python and of the command, which spell options differently.
    lines = "".join(f"<p>{escape(line.replace('`', ''))}</p>" for line in summary)
    lines = f'<div class="lines">{lines}</div>' if lines else ""
    if not headline:
        return lines
    numbers = (f"<li><b>{escape(n)}</b><small>{escape(is_)}</small></li>" for n, is_ in headline)
    folded = f"<details><summary>All results</summary>{lines}</details>"
    return f'<ul class="headline">{"".join(numbers)}</ul>{folded}'


def _listed_grasps(grasps: Sequence[Layer], *, planned: int, postures: bool) -> str:
    if not grasps:
        return ""
    rows = f'<ul class="layers">{"".join(map(_row, grasps))}</ul>'
    if postures:
        return f'<h2>Postures</h2>{rows}<p class="fine">{_MARKS}</p>'
    shown = sum(layer.identity != "together" for layer in grasps)
    which = "Ranked" if shown == planned else f"The best {shown} of {planned}, ranked"
    fine = f'<p class="fine">{which} by predicted success on the uncertain estimate.</p>'
    return f"<h2>Candidate grasps</h2>{rows}{fine}"


def _figure(picture: bytes | None) -> str:
    """Return a picture of what a camera saw; nothing for None."""
    if picture is None:
        return ""
    image = f'<img alt="Depth image" src="data:image/png;base64,{_base64(picture)}">'
    return f"<figure>{image}<figcaption>Depth image before the first touch</figcaption></figure>"


def _is_grasp(layer: Layer) -> bool:
    return layer.identity.startswith("grasp-") or layer.identity == "together"


def _row(layer: Layer, scale: ColourScale | None = None) -> str:
    checked = " checked" if layer.on else ""
    note = f"<small>{escape(layer.note)}</small>" if layer.note else ""
    hint = "; ".join(dict.fromkeys(filter(None, (layer.note, layer.detail))))
    hint = f' title="{escape(hint)}"' if hint else ""
    return (
        f'<li{hint}><label><input type="checkbox" data-layer="{escape(layer.identity)}"{checked}>'
        f"{_swatch(layer, scale)}<span>{escape(layer.label)}{note}</span></label></li>"
    )


def _swatch(layer: Layer, scale: ColourScale | None) -> str:
    paint = _RAMP if layer.identity == "estimate" and scale is not None else layer.colour
    kind = layer.identity.split("-")[0]
    return f'<i class="swatch {kind}" style="background:{paint}"></i>'


def _legend(layers: Sequence[Layer], scale: ColourScale | None) -> str:
    """Return the colour scale, and the colours of layers for a folded panel."""
    bar = ""
    if scale is not None:
        labels = "".join(f"<span>{escape(label)}</span>" for label in scale.tick_labels())
        bar = (
            '<div class="scale"><h2>Standard deviation of the estimate</h2>'
            f'<div class="bar" style="background:{_RAMP}"></div><div class="ticks">{labels}</div>'
            '<div class="ends"><span>certain</span><span>uncertain</span></div></div>'
        )
    keyed = [layer for layer in layers if layer.identity in _KEYED and layer.on]
    chips = "".join(
        f'<li data-chip="{escape(layer.identity)}">{_swatch(layer, scale)}'
        f"<span>{escape(layer.label)}</span></li>"
        for layer in keyed
    )
    return f'<div id="legend">{bar}<ul class="chips">{chips}</ul></div>'


def _player(story: Story) -> str:
    if not story.chapters:
        return ""
    chapters = "".join(
        f'<button type="button" data-chapter="{number}" style="flex:{c.end - c.start:.3f} 0 0">'
        f"{escape(c.label)}</button>"
        for number, c in enumerate(story.chapters)
    )
    return (
        '<div id="player"><button id="play" type="button" aria-label="Play"></button>'
        '<div class="line"><p><span id="caption"></span><output id="clock" for="time"></output></p>'
        f'<input id="time" type="range" min="0" max="{story.duration:.6f}" step="any"'
        f' value="{story.rest:.6f}" aria-label="Time">'
        f'<div class="chapters">{chapters}</div></div></div>'
    )
