"""Records of grasping: grasps, results of a search, prior of the load, and a role for reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, get_args, overload

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, NoGraspError, require_packages
from lis_grasp.geometry import as_pose
from lis_grasp.io.grasp_files import read_grasp_file, write_grasp_file
from lis_grasp.records import ByValue, FrozenDict, Record, fields_of, read_only, short_repr
from lis_grasp.robots.robot_model import GraspFamily
from lis_grasp.shapes.object_mass import USUAL_FRICTION, USUAL_MASS, require_load
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    import pandas

STANDOFF = 0.12
"""Length of the straight approach, which must be free [m]."""
LIFT = 0.1
"""Length of the straight lift, which must be free of obstacles [m]."""

# Nodes and weights of the Gauss-Hermite rule with three nodes, for a standard normal variable.
_NODES, _WEIGHTS = (0.0, -np.sqrt(3.0), np.sqrt(3.0)), (2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0)


# Columns of a search in a notebook.
_DISPLAYED = ("rank", "hand", "family", "fingers", "epsilon", "success_probability")


@dataclass(frozen=True, slots=True, eq=False)
class Grasp(ByValue, Record):
    """Palm pose, joint positions, contacts and quality of a grasp.

    Parameters
    ----------
    hand
        Name of the hand.
    X_OH
        Shape (4, 4): pose of the palm frame H in the object frame O.
    joint_names, joint_positions, pregrasp_positions
        J names, and positions (J,) [rad or m] in contact and opened, for one palm pose.
    approach_O
        Shape (3,), unit, in O: direction of the hand's motion to X_OH.
    contact_points, contact_normals
        Shape (C, 3): in O [m], and unit, outward of the object.
    contact_fingers
        C names: which finger makes each contact.
    contact_forces
        Shape (C, 3) [N]: planned squeeze on the object, in O.
    quality
        Values by name; ``"epsilon"`` is always there.
    accepted
        Why it was accepted, in words.
    family
        Kind of the grasp, one of `Hand.families`.

    Raises
    ------
    InvalidOptionError
        If shapes disagree, a number is not finite, or there is no such family.

    Examples
    --------
    >>> grasp = plan("box", "wsg50", grasps=1).best
    >>> grasp.pose.shape, grasp.contact_fingers
    ((4, 4), ('left', 'right'))
    """

    hand: str
    X_OH: FloatArray
    joint_names: tuple[str, ...]
    joint_positions: FloatArray
    pregrasp_positions: FloatArray
    approach_O: FloatArray
    contact_points: FloatArray
    contact_normals: FloatArray
    contact_fingers: tuple[str, ...]
    contact_forces: FloatArray
    quality: Mapping[str, float]
    accepted: str
    family: GraspFamily = "pinch"

    __repr__ = short_repr

    def __post_init__(self) -> None:
        joints, contacts = len(self.joint_names), len(self.contact_fingers)
        for name, shape in (
            ("X_OH", (4, 4)),
            ("joint_positions", (joints,)),
            ("pregrasp_positions", (joints,)),
            ("approach_O", (3,)),
            ("contact_points", (contacts, 3)),
            ("contact_normals", (contacts, 3)),
            ("contact_forces", (contacts, 3)),
        ):
            value = getattr(self, name)
            array = as_pose(value).copy() if name == "X_OH" else np.array(value, dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidOptionError(
                    f"a grasp's {name} must be finite numbers of shape {shape};"
                    f" its shape is {array.shape}",
                    option=name,
                )
            object.__setattr__(self, name, read_only(array))
        if self.family not in (families := get_args(GraspFamily)):
            raise InvalidOptionError(
                f"a grasp's family must be one of {', '.join(families)}; it is '{self.family}'",
                option="family",
            )
        for name in ("joint_names", "contact_fingers"):
            if not all(isinstance(item, str) for item in getattr(self, name)):
                raise InvalidOptionError(f"a grasp's {name} must be texts", option=name)
            object.__setattr__(self, name, tuple(getattr(self, name)))
        values = {str(name): float(value) for name, value in self.quality.items()}
        if "epsilon" not in values or not all(map(math.isfinite, values.values())):
            raise InvalidOptionError(
                f"a grasp's quality must be finite numbers, one named 'epsilon'; it is {values}",
                option="quality",
            )
        object.__setattr__(self, "quality", FrozenDict(values))

    @property
    def pose(self) -> FloatArray:
        """Pose of the palm frame H in the object frame O, shape (4, 4): `X_OH`."""
        return self.X_OH

    @property
    def epsilon(self) -> float:
        """Radius of the largest ball of wrenches that the grasp resists (Ferrari and Canny)."""
        return self.quality["epsilon"]

    @property
    def success_probability(self) -> float | None:
        """Predicted probability that a lift succeeds; None for a grasp without a prediction."""
        return self.quality.get("success_probability")


@dataclass(frozen=True, slots=True, eq=False)
class GraspSearch(ByValue, Record, Sequence[Grasp]):
    """The result of a search for grasps, which may have found none: a sequence, the best first.

    Parameters
    ----------
    grasps
        Accepted grasps.
    rejections
        Number of rejected candidates by reason (`lis_grasp.results.summary.REJECTIONS`).
    candidates
        Number of all candidates.
    hit_bodies
        Number of rejected candidates by the body beside the object that they would hit.

    Examples
    --------
    >>> search = plan("box", "wsg50", grasps=2)
    >>> search.best is search[0]
    True
    """

    grasps: tuple[Grasp, ...]
    rejections: Mapping[str, int] = field(default_factory=dict)
    candidates: int = 0
    hit_bodies: Mapping[str, int] = field(default_factory=dict)

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.grasps)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a table of the grasps, a row each, the best first.

        Its columns are the rank, hand, family, place of the palm [m], and every quality.

        Raises `InvalidOptionError` if pandas is not installed.
        """
        require_packages("pandas", extra="study", option="to_pandas")
        import pandas

        return pandas.DataFrame(self._rows()).set_index("rank")

    def _repr_html_(self) -> str:
        """Return the grasps as a small table, which a notebook displays."""
        if not self.grasps:
            return f"<p>{escape(_no_grasp(self))}</p>"
        rows = [{name: row[name] for name in _DISPLAYED if name in row} for row in self._rows()]
        head = "".join(f"<th>{escape(name)}</th>" for name in rows[0])
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(_shown(value))}</td>' for value in row.values())}</tr>"
            for row in rows
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {
                "rank": rank,
                "hand": grasp.hand,
                "family": grasp.family,
                "fingers": ", ".join(grasp.contact_fingers),
                **dict(zip("xyz", grasp.X_OH[:3, 3].tolist(), strict=True)),
                **grasp.quality,
            }
            for rank, grasp in enumerate(self.grasps, start=1)
        ]

    @overload
    def __getitem__(self, index: int) -> Grasp: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Grasp, ...]: ...
    def __getitem__(self, index: int | slice) -> Grasp | tuple[Grasp, ...]:
        return self.grasps[index]

    @property
    def best(self) -> Grasp:
        """The best grasp.

        Raises `NoGraspError` if there is none; the message counts the reasons of rejection.
        """
        if not self.grasps:
            raise NoGraspError(_no_grasp(self))
        return self.grasps[0]

    @classmethod
    def load(cls, path: Path | str) -> GraspSearch:
        """Read a grasps.json file.

        Raises `InvalidFileError` if the file is missing, is no JSON, or lacks a field.
        """
        return cls(**read_grasp_file(Path(path), Grasp))

    def save(self, path: Path | str, *, header: str = "") -> None:
        """Write a grasps.json file, the best grasp first; `header` says what made it."""
        write_grasp_file(fields_of(self), Path(path), header=header)


def _no_grasp(search: GraspSearch) -> str:
    """Return why a search found none, in words."""
    reasons = sorted(search.rejections.items(), key=lambda item: -item[1])
    counts = ", ".join(f"{name} {count}" for name, count in reasons) or "none was sampled"
    return f"no grasp was found among {search.candidates} candidates: {counts}"


def _shown(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, slots=True)
class LoadPrior:
    """Mass of an object and its friction on the hand, each log-normal.

    Raises `InvalidOptionError` if a median is out of range, or a spread is negative.
    """

    friction: float = USUAL_FRICTION  #: median of the Coulomb coefficient
    mass: float = USUAL_MASS  #: median [kg]
    #: standard deviations of the natural logarithms; 0 if the value is known
    friction_spread: float = 0.0
    mass_spread: float = 0.0
    #: displacements of the centre of mass from a mesh's [m], in O, one standard deviation each, if
    #: the object may continue beyond it there
    toward: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        require_load(mass=self.mass, friction=self.friction)
        for name in ("friction_spread", "mass_spread"):
            if not getattr(self, name) >= 0.0:
                raise InvalidOptionError.out_of_range(name, getattr(self, name), "at least 0")

    @property
    def is_known(self) -> bool:
        """Whether both values are known exactly."""
        return self.friction_spread == self.mass_spread == 0.0

    def frictions(self) -> Iterator[tuple[float, float]]:
        """Return coefficients and their weights, which add up to 1; the median comes first."""
        return _nodes(self.friction, self.friction_spread)

    def masses(self) -> Iterator[tuple[float, float]]:
        """Return masses [kg] and their weights, which add up to 1; the median comes first."""
        return _nodes(self.mass, self.mass_spread)

    def centers(self) -> Iterator[tuple[FloatArray, float]]:
        """Return displacements (3,) of the centre of mass [m] and their weights, zero first."""
        if not self.toward:
            yield np.zeros(3), 1.0
        for end in self.toward:
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                yield abs(node) * np.array(end), float(weight) / len(self.toward)


def _nodes(median: float, spread: float) -> Iterator[tuple[float, float]]:
    if spread == 0.0:
        yield median, 1.0
        return
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        yield float(median * np.exp(spread * node)), weight


ReachCheck = Callable[[FloatArray, FloatArray, FloatArray], list[str | None]]
"""Palm poses (N, 4, 4), opened and closed joint positions (N, J) -> N reasons, None in reach."""


class Reach(Protocol):
    """The reach of what carries a hand."""

    def reach_check(self, mesh: trimesh.Trimesh) -> ReachCheck:
        """Return a function that finds the grasps that cannot be carried out, and why.

        Parameters
        ----------
        mesh
            Closed mesh of the object in O [m], which is not to be hit on the way.
        """
        ...
