"""Surface estimator: a Drake system from contacts to the estimated surface of the object."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import trimesh
from pydrake.common.value import AbstractValue
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem

from lis_grasp.contacts import Contacts
from lis_grasp.drake._drawing import Drawing, show_contacts, show_estimate
from lis_grasp.drake._ports import MadeOnce, declare_output, read_port
from lis_grasp.exceptions import EstimationError, note
from lis_grasp.exploration import TactileSensor
from lis_grasp.records import Record
from lis_grasp.simulation.drake.plant_parts import pose_of, require_type, wrong_type
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.surfaces import Estimator, ImplicitSurface
from lis_grasp.surfaces.contact_checks import doubt_of_side

_DRAWN_EVERY = 0.25  # [s] of simulated time


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Estimate(Record):
    """The estimate of contacts; each part is made at its first use."""

    contacts: Contacts
    perception: Perception = field(default_factory=Perception)

    @cached_property
    def _made(self) -> SurfaceEstimate | None:
        return SurfaceEstimate(self.contacts, self.perception) if len(self.contacts) else None

    @property
    def solid(self) -> ImplicitSurface | None:
        """The surface before free space is removed; None without contacts."""
        return None if self._made is None else self._made.solid

    def guide(self, contacts: Contacts) -> ImplicitSurface:
        """Return the surface that guides touches, from the same contacts."""
        assert self.solid is not None
        return self.solid

    @property
    def surface(self) -> ImplicitSurface | None:
        """The surface without free space, above the table; None without contacts."""
        return None if self._made is None else self._made.surface

    @property
    def mesh(self) -> trimesh.Trimesh | None:
        """The closed mesh of the surface; None where contacts are too few for one."""
        try:
            return None if self._made is None else self._made.mesh
        except EstimationError:
            return None

    def draw(self, meshcat: Meshcat, path: str = "lis_grasp/estimate") -> None:
        """Draw the mesh, coloured by its uncertainty, and the contacts, in E."""
        if len(self.contacts):
            show_contacts(meshcat, f"{path}/contacts", self.contacts)
        if self.mesh is not None:
            show_estimate(meshcat, f"{path}/mesh", self.mesh)


class SurfaceEstimator(LeafSystem):
    """Estimates the surface of an object from its contacts.

    .. code-block:: text

        contacts -> SurfaceEstimator -> estimate

    ``estimate`` is a frozen record with ``contacts``, ``surface`` (None without contacts) and
    ``mesh`` (None while it is not closed), all in E, each computed at its first use.

    Parameters
    ----------
    estimator
        "blend", "gpis", "lis", "patch", a plug-in, or a function of contacts.
    noise
        The sensor's noise, which the estimator is given.
    table
        Height in E of a table that closes the estimate from below [m].
    free_space
        Whether the contacts' free space is removed from the estimate.
    meshcat
        Draws contacts and estimate whenever a contact is added.
    path
        Path of the drawing.
    X_WE
        Pose of E in the world, for the drawing.
    replay
        Keeps every version of the drawing, for Meshcat's recording.

    Raises
    ------
    InvalidOptionError
        If there is no such estimator.

    Examples
    --------
    >>> system = SurfaceEstimator("gpis")
    >>> context = system.CreateDefaultContext()
    >>> _ = system.GetInputPort("contacts").FixValue(context, contacts)
    >>> system.estimate.Eval(context).mesh.is_watertight
    True
    """

    def __init__(
        self,
        estimator: str | Estimator = "blend",
        *,
        noise: TactileSensor | None = None,
        table: float | None = None,
        free_space: bool = True,
        meshcat: Meshcat | None = None,
        path: str = "lis_grasp/estimate",
        X_WE: RigidTransform | None = None,
        replay: bool = False,
    ) -> None:
        super().__init__()
        X_WE = pose_of(X_WE, "X_WE")
        require_type("noise", noise, TactileSensor)
        if not (isinstance(estimator, str) or callable(estimator)):
            required = "the name of an estimator, or a function of contacts"
            raise wrong_type("estimator", estimator, required)
        perception = Perception(
            estimator=estimator,
            sensor=noise or TactileSensor(),
            free_space=free_space,
            support_height=table,
            normals="outward",  # as a TouchSensor's are
        )
        _ = perception.make  # raises now for an unknown name
        empty = Contacts.empty()
        self._contacts = self.DeclareAbstractInputPort("contacts", AbstractValue.Make(empty))
        self._doubt = ""

        def make(contacts: Contacts) -> Estimate:
            if not self._doubt and (doubt := doubt_of_side(contacts)):
                self._doubt = doubt
                note(doubt)  # once
            return Estimate(contacts, perception)

        self._made = MadeOnce[Contacts, Estimate](make)
        self.estimate = declare_output(
            self,
            "estimate",
            Estimate(empty, perception),
            lambda context: self._made(self._read(context)),
            {self._contacts.ticket()},
        )
        if meshcat is not None:
            self._drawing = Drawing(meshcat, path, X_WE, replay=replay)
            self.DeclarePeriodicPublishEvent(_DRAWN_EVERY, 0.0, self._draw)
            self.DeclareForcedPublishEvent(self._draw)

    def _read(self, context: Context) -> Contacts:
        source = "the output 'contacts' of a TouchSensor"
        return read_port(self._contacts, context, Contacts, source)

    def _draw(self, context: Context) -> EventStatus:
        """Draw the estimate if there are new contacts."""
        contacts = self._read(context)
        if len(contacts):
            key = contacts.points.tobytes()  # new free space alone is not drawn
            self._drawing.show(key, context.get_time(), self._made(contacts).draw)
        return EventStatus.Succeeded()
