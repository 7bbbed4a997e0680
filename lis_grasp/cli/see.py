"""`lis-grasp see`: contacts of an object from a depth image, and what the image leaves unknown."""

from __future__ import annotations

import argparse
from pathlib import Path

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import next_step, say
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.logs.depth_images import load_bag_view
from lis_grasp.logs.readers import BAG_ENDINGS
from lis_grasp.results.folder import VIEW
from lis_grasp.results.seen import SEEN_CONTACTS, SEEN_PAGE, see
from lis_grasp.views import DepthView, load_view
from lis_grasp.views.image_files import load_image, read_mask


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments to its parser."""
    parser.add_argument(
        "image",
        type=Path,
        metavar="IMAGE",
        help="depth along the optical axis: a .png of 16 bits in millimetres, a .npy in metres, an"
        " organised .pcd, a bag of ROS (.bag, .mcap, .db3 or a folder), or a view.npz",
    )
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="YAML",
        help="what IMAGE does not say of the camera's intrinsics and pose: see the page on views",
    )
    parser.add_argument(
        "--mask",
        type=Path,
        metavar="IMAGE",
        help="not 0 where the object is (default: as in the YAML file, else found above the table)",
    )
    parser.add_argument(
        "--support",
        type=float,
        default=0.0,
        metavar="METRES",
        help="height of the table under the object (default: 0)",
    )
    opt.add_output(parser, "the folder of IMAGE")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> None:
    """Write what the view shows, and print what was understood."""
    view = _load(options.image, options.camera)
    if options.mask is not None:
        view = view.with_mask(read_mask(options.mask, view.depth.shape))
    folder = options.output or options.image.parent
    seen = see(view, options.support, folder)
    for line in seen.summary:
        say(line)
    say(f"wrote {folder / VIEW}, {SEEN_CONTACTS}, {SEEN_PAGE}")
    estimate = "lis-grasp estimate {} --view {} --support {}"
    say(next_step(estimate, folder / SEEN_CONTACTS, folder / VIEW, f"{options.support:g}"))


def _load(image: Path, camera: Path | None) -> DepthView:
    """Return the view of a file, by its kind."""
    ending = image.suffix.lower()
    if ending == ".npz" and camera is None:
        return load_view(image)
    if ending in BAG_ENDINGS or image.is_dir():
        return load_bag_view(image, camera)
    if camera is None and ending != ".pcd":
        message = f"{image} needs --camera, the YAML file of its intrinsics and pose"
        raise InvalidOptionError(message, option="camera")
    return load_image(image, camera)
