"""True objects: the paper's shapes with exact edge lines, and mesh files.

Every object is upright on the plane z = (lowest z of its mesh), in metres, in its frame O.

Examples
--------
>>> shapes.find("box").name
'box'
"""

from lis_grasp._moved import module_names
from lis_grasp.io.units import UNITS
from lis_grasp.shapes.builtin import (
    BUILDERS,
    GRASPABLE_SIZES,
    NAMES,
    PAPER_SIZE,
    box,
    build,
    cylinder,
    half_cylinder,
    hollow_cylinder,
    mallet,
    pentagon,
    sphere,
    torus,
)
from lis_grasp.shapes.loading import FORMATS, find, load
from lis_grasp.shapes.object_mass import default_mass
from lis_grasp.shapes.placement import (
    STABLE,
    UPRIGHT,
    draw_pose,
    placed,
    placed_as_recorded,
)
from lis_grasp.shapes.resting import RestingPose, resting_poses, roll_to_rest
from lis_grasp.shapes.shape import SHARP_ANGLE, Shape, sharp_edges

__all__ = [
    "BUILDERS",
    "FORMATS",
    "GRASPABLE_SIZES",
    "NAMES",
    "PAPER_SIZE",
    "SHARP_ANGLE",
    "STABLE",
    "UNITS",
    "UPRIGHT",
    "RestingPose",
    "Shape",
    "box",
    "build",
    "cylinder",
    "default_mass",
    "draw_pose",
    "find",
    "half_cylinder",
    "hollow_cylinder",
    "load",
    "mallet",
    "pentagon",
    "placed",
    "placed_as_recorded",
    "resting_poses",
    "roll_to_rest",
    "sharp_edges",
    "sphere",
    "torus",
]
__getattr__, __dir__ = module_names(__name__, __all__)
