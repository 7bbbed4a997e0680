"""Touch sensor: a Drake system that turns contact results into contacts of the touched object."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Frame, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context, EventStatus, InputPort, LeafSystem, State

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_positive
from lis_grasp.exploration.probe_motions import TRANSIT_SPEED
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.touch_detection import TouchDetection
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.probing.course import FREE_POINT_SPACING
from lis_grasp.robots.link_bodies import balls_inside
from lis_grasp.simulation.drake._touch_record import TouchRecord
from lis_grasp.simulation.drake.contact_methods import ContactMethods
from lis_grasp.simulation.drake.contact_patches import (
    FlatPart,
    LinkContact,
    contacts_of_parts,
    link_contacts,
)
from lis_grasp.simulation.drake.hand_plant import HandInPlant, require_in_plant
from lis_grasp.simulation.drake.plant_parts import (
    bodies_of,
    frame_of,
    pose_of,
    require_plant,
    require_type,
    wrong_type,
)
from lis_grasp.typing import FloatArray, IndexArray

# Between looks at the hand's poses for free space [s].
_SWEEP_PERIOD = FREE_POINT_SPACING / TRANSIT_SPEED
# Between samples in a plant without a time step [s]: a probe moves 0.2 mm.
_PERIOD = 0.002

_NOTHING = Contacts.empty()


class TouchSensor(LeafSystem):
    """Feels with every link of a hand, and remembers where it touched.

    A contact is the area-weighted centroid of a contact patch and its outward normal; a patch
    across an edge counts as two. Of point contact, the witness point on the object counts. An
    `InexactContactWarning` names each pair of bodies whose contact is not exact.

    Frames: W world; E frame of the contacts, fixed in W, or to a body.

    .. code-block:: text

        contact_results, body_poses, enable, reset -> TouchSensor -> touch, contacts

    ``enable`` and ``reset`` are vectors of one number and may be unconnected: the sensor feels
    while ``enable`` is not 0, and a ``reset`` that rises above 0 empties the record. ``body_poses``
    is needed for ``space`` and ``frame`` only. ``touch`` are the `Contacts` at this moment,
    ``contacts`` all since the beginning or the reset, with free space.

    Parameters
    ----------
    plant
        The finalized plant.
    hand
        The hand in it, as `add_hand` returns it.
    feels
        Bodies or model instances whose contact counts, or their names; None for all that is not
        the hand.
    X_WE
        The frame E in the world or, with `frame`, in the body's frame; None for the identity.
    frame
        A body or a frame with which E moves; None for the world.
    threshold
        Least normal force of a contact [N].
    spacing
        A touch that slides is recorded again after this distance [m]; None for once.
    noise
        The sensor's noise; None for an ideal sensor.
    seed
        Of the noise.
    space
        The object's place and size in E, or the region that contains it. Balls of free space that
        the hand sweeps there are recorded.
    period
        Time between samples [s]; None for the plant's time step, or 2 ms in a continuous plant,
        and inf for no record.

    Raises
    ------
    InvalidOptionError
        If the plant is not finalized, the hand is of another plant, nothing can be felt, or an
        option is out of range.

    Examples
    --------
    >>> builder = DiagramBuilder()
    >>> plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    >>> hand, body = add_hand(plant, "wsg50"), add_object(plant, "box")
    >>> plant.Finalize()
    >>> sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body]))
    >>> results = plant.get_contact_results_output_port()
    >>> _ = builder.Connect(results, sensor.GetInputPort("contact_results"))
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        hand: HandInPlant,
        *,
        feels: Iterable[RigidBody | ModelInstanceIndex | str] | None = None,
        X_WE: RigidTransform | None = None,
        frame: RigidBody | Frame | str | None = None,
        threshold: float = 0.2,
        spacing: float | None = None,
        noise: TactileSensor | None = None,
        seed: int = 0,
        space: Workspace | Region | None = None,
        period: float | None = None,
    ) -> None:
        super().__init__()
        if not require_plant(plant).is_finalized():
            raise InvalidOptionError(
                "TouchSensor needs a finalized plant: call plant.Finalize() first", option="plant"
            )
        require_in_plant("TouchSensor", hand)
        if hand.base.GetParentPlant() is not plant:
            raise InvalidOptionError(
                "TouchSensor needs a hand of its plant: this one is in another", option="hand"
            )
        require_type("noise", noise, TactileSensor)
        if period is not None and not (isinstance(period, float) and np.isposinf(period)):
            require_positive(period=period)
        self._felt_geometries = _geometries(plant, hand, feels)
        if not self._felt_geometries:
            raise InvalidOptionError(
                "TouchSensor has nothing to feel: none of the bodies has collision geometry",
                option="feels",
            )
        self._hand, self._noise, self._seed, self._space = hand, noise, seed, space
        self._detection = TouchDetection(threshold=threshold, spacing=spacing)
        self._X_FE = pose_of(X_WE, "X_WE").GetAsMatrix4()
        self._frame: BodyIndex | None = None
        if frame is not None:
            moving = frame_of(plant, frame, "frame")
            self._frame = moving.body().index()
            self._X_FE = moving.GetFixedPoseInBodyFrame().GetAsMatrix4() @ self._X_FE
        self._bodies, self._owners, self._balls = _balls_of(hand)
        self._methods = ContactMethods(hand, self._felt_geometries)
        declare = self.DeclareAbstractInputPort
        self._results: InputPort = declare("contact_results", AbstractValue.Make(ContactResults()))
        self._poses: InputPort = declare("body_poses", AbstractValue.Make([RigidTransform()]))
        self._enable = self.DeclareVectorInputPort("enable", 1)
        self._reset = self.DeclareVectorInputPort("reset", 1)
        state = self.DeclareAbstractState(AbstractValue.Make(TouchRecord()))
        needed = {self._results.ticket()} | ({self._poses.ticket()} if frame is not None else set())
        self.touch = self.DeclareAbstractOutputPort(
            "touch", lambda: AbstractValue.Make(_NOTHING), self._touch, needed
        )
        self.contacts = self.DeclareAbstractOutputPort(
            "contacts",
            lambda: AbstractValue.Make(_NOTHING),
            lambda context, output: output.set_value(_record_in(context.get_state()).contacts),
            {self.abstract_state_ticket(state)},
        )
        if period is None:
            period = plant.time_step() or _PERIOD
        if np.isfinite(period):
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._record)
            if space is not None:
                self.DeclarePeriodicUnrestrictedUpdateEvent(_SWEEP_PERIOD, 0.0, self._sweep)

    def _touch(self, context: Context, output: AbstractValue) -> None:
        """Calculate the contacts at this moment."""
        strong = self._strong(context, self._detection.threshold)
        output.set_value(self._contacts(context, [part for c in strong for part in c.flat_parts()]))

    def _record(self, context: Context, state: State) -> EventStatus:
        """Add what has begun to touch."""
        before = _record_in(state)
        after = before
        reset = self._reset.HasValue(context) and self._reset.Eval(context)[0] > 0.0
        if reset and not before.was_reset:
            after = TouchRecord()
        if reset != after.was_reset:
            after = replace(after, was_reset=reset)
        after = self._with_touches(context, after) if self._listens(context) else after.idle()
        return _updated(state, before, after)

    def _with_touches(self, context: Context, record: TouchRecord) -> TouchRecord:
        """Return the record after this moment."""
        contacts = self._strong(context, self._detection.release * self._detection.threshold)
        if not contacts and not record.touching:
            return record
        X_EW = inverse_pose(self._X_WE(context))
        record, added = record.begun(
            [contact.link for contact in contacts],
            [apply_pose(X_EW, contact.point) for contact in contacts],
            [contact.normal_force for contact in contacts],
            self._detection,
        )
        if not added:
            return record
        found = self._contacts(context, [p for k in added for p in contacts[k].flat_parts()])
        if self._noise is not None:
            rng = np.random.default_rng([self._seed, len(record.contacts)])
            found = self._noise.sense(found, rng=rng)
        return record.with_contacts(found)

    def _sweep(self, context: Context, state: State) -> EventStatus:
        """Add the free space that the hand has swept since the last look."""
        record = _record_in(state)
        if not self._listens(context):
            return EventStatus.DidNothing()
        assert self._space is not None
        every, X_EW = self._poses.Eval(context), inverse_pose(self._X_WE(context))
        X_EL = X_EW @ np.array([every[body].GetAsMatrix4() for body in self._bodies])
        centers = apply_pose(X_EL[self._owners], self._balls[:, None, :3])[:, 0]
        space = self._space.grown(record.contacts)
        return _updated(state, record, record.looked_at(centers, self._balls[:, 3], space))

    def _listens(self, context: Context) -> bool:
        return not self._enable.HasValue(context) or self._enable.Eval(context)[0] != 0.0

    def _strong(self, context: Context, force: float) -> list[LinkContact]:
        """Return the contacts with more normal force [N], in W."""
        results = self._results.Eval(context)
        contacts = link_contacts(results, self._felt_geometries, self._hand.link_of_geometry)
        strong = [contact for contact in contacts if contact.normal_force > force]
        self._methods.check(strong)
        return strong

    def _contacts(self, context: Context, parts: list[FlatPart]) -> Contacts:
        """Return flat parts in W as contacts in E."""
        if not parts:
            return _NOTHING
        X_WE = self._X_WE(context)
        if not np.array_equal(X_WE, np.eye(4)):
            X_EW = inverse_pose(X_WE)
            parts = [
                replace(part, point=apply_pose(X_EW, part.point), normal=rotate(X_EW, part.normal))
                for part in parts
            ]
        return contacts_of_parts(parts, context.get_time())

    def _X_WE(self, context: Context) -> FloatArray:
        if self._frame is None:
            return self._X_FE
        X_WF: FloatArray = self._poses.Eval(context)[self._frame].GetAsMatrix4()
        return X_WF @ self._X_FE


def _record_in(state: State) -> TouchRecord:
    record: TouchRecord = state.get_abstract_state(0).get_value()
    return record


def _updated(state: State, before: TouchRecord, after: TouchRecord) -> EventStatus:
    """Set the record, and say if there was nothing to set: then nothing is computed again."""
    if after is before:
        return EventStatus.DidNothing()
    state.get_mutable_abstract_state(0).set_value(after)
    return EventStatus.Succeeded()


def _geometries(
    plant: MultibodyPlant,
    hand: HandInPlant,
    feels: Iterable[RigidBody | ModelInstanceIndex | str] | None,
) -> dict[GeometryId, RigidBody]:
    """Return the collision geometries that are felt, and their bodies."""
    if isinstance(feels, RigidBody | Frame | ModelInstanceIndex | str):
        feels = [feels]
    if feels is None:
        instances = [ModelInstanceIndex(i) for i in range(plant.num_model_instances())]
        feels = [instance for instance in instances if instance != hand.instance]
    if not isinstance(feels, Iterable):
        raise wrong_type("feels", feels, "bodies or model instances of the plant")
    of_hand = hand.link_of_geometry
    return {
        geometry: body
        for felt in feels
        for body in bodies_of(plant, felt, "feels")
        for geometry in plant.GetCollisionGeometriesForBody(body)
        if geometry not in of_hand
    }


def _balls_of(hand: HandInPlant) -> tuple[list[BodyIndex], IndexArray, FloatArray]:
    """Return bodies, and balls inside of them: their bodies (B,), centres and radii (B, 4) [m]."""
    geometries = [(g, *balls_inside(g)) for g in hand.hand.link_geometries]
    links = list(dict.fromkeys(g.link for g, _, _ in geometries))
    owners = [links.index(g.link) for g, _, radii in geometries for _ in radii]
    balls = [np.column_stack([apply_pose(g.X_LG, c), r]) for g, c, r in geometries]
    bodies = [hand.links.bodies[link].index() for link in links]
    return bodies, np.array(owners, dtype=np.intp), np.concatenate([np.empty((0, 4)), *balls])
