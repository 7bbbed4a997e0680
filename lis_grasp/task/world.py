"""The true world: the object, where it is, its mass and friction, and what simulates it.

Only simulators and evaluation may see it.
"""

from __future__ import annotations

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.io.option import POSITIVE, option, record_of_options, within
from lis_grasp.shapes import NAMES, STABLE, UNITS
from lis_grasp.shapes.loading import UP_AXES
from lis_grasp.shapes.object_mass import MOST_FRICTION, USUAL_FRICTION
from lis_grasp.task.option_groups import GRASPING, TOUCHING

FRICTION = within(f"above 0 and at most {MOST_FRICTION:g}", lambda x: 0 < x <= MOST_FRICTION)


PROBERS = ("dynamic", "kinematic")
"""Probers: Drake's dynamics, or geometry alone."""

SIMULATORS = ("drake", "cenic", "mujoco")
"""Simulators of a lift: Drake in time steps, Drake's error-controlled integrator, and MuJoCo."""


@record_of_options
class World:
    """The true object, where it is, and the simulators that see it.

    None stands for the default in words. A value out of range, or two values that contradict each
    other, raise `InvalidOptionError`.

    Examples
    --------
    >>> World(object="mallet", friction=0.6).prober
    'dynamic'
    """

    object: str = option(
        "box",
        f"built-in shape ({', '.join(NAMES)}) or mesh file (STL, OBJ, PLY, 3MF, glTF, OFF, DAE)",
    )
    size: float | None = option(
        None,
        "largest extent of a built-in shape; 0.20 is the paper's",
        metavar="METRES",
        words="graspable",
        check=POSITIVE,
    )
    units: str | None = option(
        None, "length unit of a mesh file", choices=tuple(UNITS), words="what it states, else m"
    )
    up: str | None = option(
        None, "axis of a mesh file that points up", choices=UP_AXES, words="what it states, else z"
    )
    pose: str | None = option(
        STABLE,
        "the object is on a table: upright (as its mesh) or stable (in any stable pose), at a"
        " random place in the region; or a text file with its pose, four rows of four numbers [m]",
        metavar="POSE",
        words="stable; none with --known",
    )
    free: bool | None = option(
        None,
        "the object is free on a table and may be pushed; needs `prober` dynamic",
        words="yes; no with --known, --clamped or --prober kinematic",
    )
    mass: float | None = option(
        None,
        "mass of the object",
        GRASPING,
        metavar="KG",
        words="of YCB scans their own, else at most 0.2",
        words_else="at most 0.2",
        check=POSITIVE,
    )
    friction: float = option(
        USUAL_FRICTION,
        "Coulomb friction between hand and object",
        GRASPING,
        metavar="MU",
        check=FRICTION,
    )
    prober: str = option(
        "dynamic",
        "touch in Drake's dynamics, or by geometry alone, which is faster",
        TOUCHING,
        choices=PROBERS,
    )
    simulator: str = option(
        "drake",
        "simulator of the lift: drake in steps of 5 ms, cenic with Drake's error-controlled ones;"
        " mujoco needs the extra mujoco",
        GRASPING,
        choices=SIMULATORS,
    )

    def __post_init__(self) -> None:
        if self.is_free and self.prober != "dynamic":
            raise InvalidOptionError(
                f"a free object needs the dynamic prober; it is {self.prober}", option="free"
            )

    @property
    def is_free(self) -> bool:
        """Whether touches may push the object; by default if Drake's dynamics simulate them."""
        return self.prober == "dynamic" if self.free is None else self.free
