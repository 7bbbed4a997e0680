"""Make images/run.gif or another animation of the scene of a run, with Chromium.

lis-grasp run mallet --known --seed 3 --hand leap --prober kinematic --output results/mallet
python docs/make_animation.py results/mallet
lis-grasp run box --known --seed 3 --arm iiwa14 --touches 20 --output results/arm
python docs/make_animation.py results/arm --name arm --to-azimuth 60
lis-grasp run mallet --seed 3 --camera --touches 3 --place table --output results/see
python docs/make_animation.py results/see --name see
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

_FRAMES = 50
_TURN = 40.0  # of the camera [deg]
_SIZE = (560, 440)
_COLOURS = 64
_FRAME_TIME, _LAST_FRAME_TIME = 160, 2500  # [ms]


def main() -> None:
    """Picture the scene at evenly spread times, from a camera that goes round it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of results")
    parser.add_argument("--name", default="run", help="of the picture (default: run)")
    parser.add_argument("--to-azimuth", type=float, help="degrees (default: the page's)")
    options = parser.parse_args()
    scene = options.folder.resolve() / "scene.html"
    page = scene.read_text(encoding="utf-8")
    found = [re.search(rf'"{name}": ?(-?[\d.]+)', page) for name in ("duration", "azimuth")]
    duration, azimuth = (float(match[1]) for match in found if match)
    azimuth = azimuth if options.to_azimuth is None else options.to_azimuth
    frames = []
    with Browser() as browser:
        for k in range(_FRAMES):
            time = duration * (k + 0.5) / _FRAMES
            view = f"azimuth={azimuth - _TURN * (1 - k / _FRAMES):.1f}"
            browser.open(f"{scene.as_uri()}#panel=0&t={time:.3f}&{view}", _SIZE)
            png = browser.send("Page.captureScreenshot", format="png")["data"]
            image = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
            frames.append(image.quantize(_COLOURS, dither=Image.Dither.NONE))
    frames[0].save(
        _HERE / "images" / f"{options.name}.gif",
        save_all=True,
        append_images=frames[1:],
        duration=[_FRAME_TIME] * (_FRAMES - 1) + [_LAST_FRAME_TIME],
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main()
