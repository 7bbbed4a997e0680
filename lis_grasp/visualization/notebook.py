"""HTML of pages and pictures, which a notebook displays."""

from __future__ import annotations

import base64
from html import escape


def framed(page: str, title: str) -> str:
    """Return a page in a frame, as HTML for a notebook."""
    return (
        f'<iframe srcdoc="{escape(page)}" title="{escape(title)}"'
        ' style="width: 100%; height: 640px; border: 0; border-radius: 8px"></iframe>'
    )


def image(png: bytes, width: int = 320) -> str:
    """Return a PNG as an HTML image for a notebook, `width` wide [pixels]."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="picture" width="{width}" src="data:image/png;base64,{data}"/>'
