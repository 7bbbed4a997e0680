"""What the robot knows beforehand of the object and its surroundings."""

from __future__ import annotations

from pydantic import InstanceOf

from lis_grasp.exploration import DEFAULT_REGION, Region
from lis_grasp.io.option import option, record_of_options
from lis_grasp.task.option_groups import CAMERA, TOUCHING
from lis_grasp.world import Surroundings


@record_of_options
class Known:
    """The region that contains the object, what is known of its load, and its surroundings.

    Examples
    --------
    >>> Known(region=(0.3, 0.3, 0.2)).load
    'unknown'
    """

    region: tuple[float, ...] | None = option(
        DEFAULT_REGION,
        "lengths [m] of the box on the table that contains the object: position and size of the"
        " object are then unknown",
        metavar=("X", "Y", "Z"),
        words="0.4 0.4 0.3; none with --known",
        check=lambda name, value: Region(value).lengths,
    )
    load: str = option(
        "unknown",
        "prior knowledge of the object's mass and friction in planning: their values, or their"
        " distributions",
        choices=("known", "unknown"),
        words="unknown; known with --known",
        words_else="known",
    )
    cloud: str | None = option(
        None,
        "contacts known before the first touch, in the frame of the touches, the mesh's unless a"
        " `pose` file places it on the table: a point cloud with normals, of any format that"
        " estimate reads; touches go where it lacks the surface",
        TOUCHING,
        metavar="FILE",
    )
    views: tuple[str, ...] | None = option(
        None,
        "what a depth camera saw before the first touch, in the frame of the table: view.npz of"
        " lis-grasp see; touches go where it lacks the surface",
        CAMERA,
        metavar="FILE",
    )
    world: str | InstanceOf[Surroundings] | None = option(
        None,
        "bodies beside the object, which hand, arm and what they carry must not hit, such as a bin,"
        " a shelf or neighbours: model directives of Drake or one of their models, in the frame of"
        " the table, or a mesh [m], in that of the touches; FILE#NAME is one scenario of several",
        metavar="FILE",
    )
    at: str | None = option(
        None,
        "where the table's frame is in the world's: a body or frame, such as bin::inside, or three"
        " numbers [m]",
        metavar="PLACE",
        words="its origin",
    )
