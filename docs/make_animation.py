"""Make images/run.gif, an animation of the scene of a run, with Chromium.

lis-grasp run mallet --known --seed 3 --output results/mallet
python docs/make_animation.py results/mallet
"""

from __future__ import annotations

import argparse
import base64
import io
import re
import sys
from pathlib import Path

from PIL import Image

_HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(_HERE.parent / "tests"))

from browser import Browser  # noqa: E402

_FRAMES = 56
_SIZE = (480, 400)
_COLOURS = 64
_FRAME_TIME, _LAST_FRAME_TIME = 160, 2500  # [ms]


def main() -> None:
    """Picture the scene at evenly spread times, from a camera that goes round it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of results")
    scene = parser.parse_args().folder.resolve() / "scene.html"
    found = re.search(r'"duration": ?([\d.]+)', scene.read_text(encoding="utf-8"))
    if found is None:
        sys.exit(f"{scene} has no story")
    frames = []
    with Browser() as browser:
        for k in range(_FRAMES):
            time = float(found[1]) * (k + 0.5) / _FRAMES
            view = f"azimuth={110 + 40 * k / _FRAMES:.1f}&zoom=1.15"
            browser.open(f"{scene.as_uri()}#panel=0&t={time:.3f}&{view}", _SIZE)
            png = browser.send("Page.captureScreenshot", format="png")["data"]
            image = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
            frames.append(image.quantize(_COLOURS, dither=Image.Dither.NONE))
    frames[0].save(
        _HERE / "images" / "run.gif",
        save_all=True,
        append_images=frames[1:],
        duration=[_FRAME_TIME] * (_FRAMES - 1) + [_LAST_FRAME_TIME],
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main()
