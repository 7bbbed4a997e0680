"""Self-contained HTML page: meshcat's viewer, drawing commands and overlay in one file."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

_HERE = "lis_grasp.visualization"
# In the order of their dependencies.
_SCRIPTS = ("appearance.js", "story.js", "camera.js", "scene.js")


def build_page(
    title: str, *, overlay: str, scene: Mapping[str, Any], commands: Sequence[bytes]
) -> str:
    """Return a page that draws `commands` with meshcat's viewer, offline.

    `title` is plain text, `overlay` is escaped HTML, `scene` has JSON values for the page's script.
    The Content Security Policy allows no connection and only the page's own two scripts, so that
    names that look like markup cannot run.
    """
    viewer = _script_text(_viewer())
    script = _script_text("".join(_asset(name) for name in _SCRIPTS))
    style = _asset("scene.css")
    facts = {
        **scene,
        "lengths": [len(command) for command in commands],
        "commands": _base64(zlib.compress(b"".join(commands), 1)),  # higher levels save 3 %
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
    """Return meshcat's viewer with three.js; importing meshcat would load its server."""
    file = distribution("meshcat").locate_file("meshcat/viewer/dist/main.min.js")
    return Path(str(file)).read_text(encoding="utf-8")


def _script_text(source: str) -> str:
    # Only "</script" ends a script element; in a JavaScript string "<\/" equals "</".
    # HTML parsers turn \r\n into \n, which would change the hash of the script.
    return source.replace("\r\n", "\n").replace("</script", "<\\/script")


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
