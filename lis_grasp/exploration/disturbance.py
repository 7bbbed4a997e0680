"""Disturbance of the bodies beside the object by simulated touches: truth, for evaluation alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Protocol, runtime_checkable

from lis_grasp.exploration.probe import Prober
from lis_grasp.geometry import require_pose
from lis_grasp.records import Record, read_only, reduce_record
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance(Record):
    """What the touches of a prober did so far to the bodies beside the object, by their names.

    Examples
    --------
    >>> once = Disturbance(contacts={"wall": 1}, forces={"wall": 0.4})
    >>> dict(once.after(Disturbance(contacts={"wall": 2}, forces={"wall": 0.3})).contacts)
    {'wall': 3}
    """

    #: number of contacts that the hand felt, in truth
    contacts: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    #: largest force [N] of the hand, the arm or the object on each
    forces: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    #: poses (4, 4) of the free bodies, in the frame of the first probe
    poses: Mapping[str, FloatArray] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        poses = {name: read_only(require_pose(name, X)) for name, X in self.poses.items()}
        for name, values in (("contacts", self.contacts), ("forces", self.forces)):
            object.__setattr__(self, name, MappingProxyType(dict(values)))
        object.__setattr__(self, "poses", MappingProxyType(poses))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)

    def after(self, later: Disturbance) -> Disturbance:
        """Return what this and then a later one did."""
        contacts, forces = dict(self.contacts), dict(self.forces)
        for name, count in later.contacts.items():
            contacts[name] = contacts.get(name, 0) + count
        for name, force in later.forces.items():
            forces[name] = max(force, forces.get(name, 0.0))
        return replace(self, contacts=contacts, forces=forces, poses={**self.poses, **later.poses})

    def equals(self, other: Disturbance | None) -> bool:
        """Return whether another is the same to the last bit."""
        if other is None or self.contacts != other.contacts or self.forces != other.forces:
            return False
        ours, theirs = (
            {name: X.tobytes() for name, X in one.poses.items()} for one in (self, other)
        )
        return ours == theirs


@runtime_checkable
class DisturbingProber(Prober, Protocol):
    """A simulated prober that knows what its touches do to the bodies beside the object."""

    @property
    def disturbance(self) -> Disturbance:
        """What its touches did so far."""
        ...
