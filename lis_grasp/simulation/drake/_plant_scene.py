"""Drake plant with its simulator, in which scenes put a hand, an object and a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    FilterId,
    GeometryId,
    GeometrySet,
    Role,
)
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import SimulationError
from lis_grasp.lifting.scene import Touched
from lis_grasp.simulation.drake.contact_patches import LinkContact, link_contacts, patch_forces
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.simulation.drake.object_plant import ObjectInPlant, let_rest
from lis_grasp.simulation.drake.plant_parts import rigid
from lis_grasp.simulation.drake.surroundings_plant import (
    Pusher,
    SurroundingsInPlant,
    add_surroundings,
)
from lis_grasp.simulation.drake.touch_sensor import TouchSensor
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

Scheme = Literal["discrete", "cenic"]
"""How Drake advances a scene: in its time steps, or with error-controlled ones within them."""

_ACCURACY = 1e-3  # of CENIC's steps


class PlantScene:
    """A plant, its context and its simulator, advanced one time step at a time.

    Hand, carrier, object and table are added to `plant` first; `finalize` makes the rest. Contact
    is hydroelastic, in Drake's discrete solver with the "lagged" approximation. The links of the
    hand do not collide with each other. `surroundings` are the bodies beside the object, in W.
    `settings` are fields of `MultibodyPlantConfig`.

    With the scheme "cenic", the plant is continuous, and Drake's error-controlled convex integrator
    (Kurtz & Castro 2025) chooses its steps within a time step. It cannot lock joints, so nothing is
    locked, and Drake's contact results have another friction than its own; see `object_force`.
    """

    #: the bodies beside the object; None without any
    surroundings: SurroundingsInPlant | None = None

    def __init__(
        self,
        time_step: float,
        *,
        surroundings: Surroundings = ALONE,
        scheme: Scheme = "discrete",
        **settings: Any,
    ) -> None:
        self._builder, self.scheme = DiagramBuilder(), scheme
        config = MultibodyPlantConfig(
            time_step=time_step if scheme == "discrete" else 0.0,
            discrete_contact_approximation="lagged",
            **settings,
        )
        added: tuple[MultibodyPlant, Any] = AddMultibodyPlant(config, self._builder)
        self.plant, self._scene_graph = added
        self._is_sampled = bool(config.use_sampled_output_ports)
        self.time_step = time_step
        self.steps = 0
        #: largest force [N] on each body beside the object so far, by who pushed it
        self.pushes: dict[tuple[str, Pusher], float] = {}
        #: forces [N] in the last step, likewise
        self.forces_beside: Mapping[tuple[str, Pusher], float] = {}
        self._unmoved: FilterId | None = None
        self._is_object_locked = False
        #: free bodies beside the object that are locked where they are
        self.resting: set[str] = set()
        self._separated = False
        if len(surroundings):
            self.surroundings = add_surroundings(self.plant, surroundings)

    def finalize(
        self,
        hand: HandInPlant,
        obj: ObjectInPlant,
        *,
        support: GeometryId | None = None,
        table: GeometryId | None = None,
        threshold: float | None = None,
    ) -> None:
        """Finalize the plant with its hand and its floating object, and make the simulator.

        With a `threshold` [N], there is a touch sensor for the object, and for bodies beside it.
        """
        plant, scene_graph = self.plant, self._scene_graph
        plant.Finalize()
        self.hand, self.object, self.support, self.table = hand, obj, support, table
        let_rest(scene_graph, obj.geometry, support=support, table=table)
        # Drake gives a body without a joint this one: six degrees of freedom.
        (joint,) = plant.GetJointIndices(obj.body.model_instance())
        self.object_joint = plant.get_joint(joint)
        beside, sensor = self.surroundings, None
        tables = [slab for slab in (support, table) if slab is not None]
        if beside is not None:
            beside.let_rest(scene_graph, obj.geometry, tables)
            pushers: dict[GeometryId, Pusher] = dict.fromkeys(
                scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity), "arm"
            )
            pushers |= dict.fromkeys(hand.link_of_geometry, "hand") | {obj.geometry: "object"}
            for passive in (*tables, *beside.grounds.values(), *beside.name_of_geometry):
                del pushers[passive]
            self._pushers = pushers
        if threshold is not None:
            feels = [obj.body, *(() if beside is None else beside.bodies.values())]
            sensor = TouchSensor(plant, hand, feels=feels, threshold=threshold, period=np.inf)
            self._builder.AddSystem(sensor)
            self._builder.Connect(
                plant.get_contact_results_output_port(), sensor.GetInputPort("contact_results")
            )
        self.simulator = Simulator(self._builder.Build())
        if self.scheme == "cenic":
            scheme = SimulatorConfig(
                integration_scheme="cenic", max_step_size=self.time_step, accuracy=_ACCURACY
            )
            ApplySimulatorConfig(scheme, self.simulator)
        self._root = self.simulator.get_mutable_context()
        self.context: Context = plant.GetMyMutableContextFromRoot(self._root)
        if sensor is not None:
            self._touch = sensor.touch, sensor.GetMyContextFromRoot(self._root)
        if beside is not None:
            beside.place(self.context, {body.name: body.X_EB for body in beside.surroundings})
        geometry_context = scene_graph.GetMyMutableContextFromRoot(self._root)
        self.filters = scene_graph.collision_filter_manager(geometry_context)

    def place_object(self, X_WO: FloatArray) -> None:
        """Set the pose of the object, shape (4, 4): a rotation but for rounding."""
        self.object_joint.SetPose(self.context, rigid(X_WO))

    def lock_object(self) -> None:
        """Lock the object where it is, until it is unlocked."""
        if self.scheme == "cenic":
            return
        self._is_object_locked = True
        self._separate_locked()
        self.object_joint.Lock(self.context)

    def unlock_object(self) -> None:
        """Free an object that was locked."""
        if not self._is_object_locked:
            return
        self._is_object_locked = False
        self._separate_locked()
        self.object_joint.Unlock(self.context)

    def pull(self, link: RigidBody, point: FloatArray, force: FloatArray) -> None:
        """Apply a force (3,) [N] at a point (3,) on the object, and its reaction on a link, in W.

        It lasts until the next call, and its points move with the bodies.
        """
        applied = []
        for body, sign in ((self.object.body, 1.0), (link, -1.0)):
            on_body = ExternallyAppliedSpatialForce()
            on_body.body_index = body.index()
            on_body.p_BoBq_B = body.EvalPoseInWorld(self.context).inverse() @ point
            on_body.F_Bq_W = SpatialForce(np.zeros(3), sign * force)
            applied.append(on_body)
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, applied)

    def place_surroundings(self, poses: Mapping[str, FloatArray]) -> None:
        """Place free bodies beside the object, at rest at poses X_WB (4, 4) by name.

        They are locked until something touches them: tilted ones would rock on their soft ground,
        whose contact need not be computed until then. The first time, what stands on or leans on
        each other is found; see `separate`.
        """
        beside = self.surroundings
        if beside is None:
            return
        beside.place(self.context, poses)
        if not self._separated:
            query = self.plant.get_geometry_query_input_port().Eval(self.context)
            beside.separate(self.filters, query, self.object.geometry)
            self._separated = True
        if self.scheme == "cenic":
            return
        self.resting = set(beside.grounds)
        self._separate_locked()
        for name in beside.grounds:
            beside.joint(name).Lock(self.context)

    def _unlock_touched(self) -> None:
        """Free the locked bodies beside the object that something touches."""
        if self.surroundings is None or not self.resting:
            return
        touched = self.resting & self.surroundings.touched(self._results())
        if touched:
            self.resting -= touched
            self._separate_locked()
            for name in sorted(touched):
                self.surroundings.joint(name).Unlock(self.context)

    def _separate_locked(self) -> None:
        """Let locked bodies touch neither each other nor what is fixed: Drake 1.51 crashes."""
        if self._unmoved is not None:
            self.filters.RemoveDeclaration(self._unmoved)
            self._unmoved = None
        locked = [self.object.geometry] if self._is_object_locked else []
        fixed = [] if self.support is None else [self.support]
        if self.surroundings is not None:
            fixed += self.surroundings.unmoving_geometries
            locked += self.surroundings.geometries(self.resting)
        if locked and (fixed or len(locked) > 1):
            declaration = CollisionFilterDeclaration()
            declaration.ExcludeWithin(GeometrySet(locked))
            declaration.ExcludeBetween(GeometrySet(locked), GeometrySet(fixed))
            self._unmoved = self.filters.ApplyTransient(declaration)

    def stop(self) -> None:
        """Set all velocities to 0."""
        self.plant.SetVelocities(self.context, np.zeros(self.plant.num_velocities()))

    def restart(self) -> None:
        """Begin another motion at time 0, so that its rounding is the same for every motion."""
        self._root.SetTime(0.0)
        self.simulator.Initialize()
        self.steps = 0

    def step(self, *, of: str) -> None:
        """Advance by one time step.

        Raises `SimulationError` if Drake fails; its message names what the simulation is `of`.
        """
        self.steps += 1
        time, self._velocity = self.steps * self.time_step, self._object_velocity()
        try:
            # Ports that are not sampled have the forces of the next step, whose solution it uses.
            if not self._is_sampled:
                self._note_contacts()
            self.simulator.AdvanceTo(time)
            if self._is_sampled:
                self._note_contacts()
        except (RuntimeError, SystemExit) as error:  # SystemExit: an assertion of Drake's failed
            reason = str(error).splitlines()[0]
            message = f"the simulation of {of} failed at {time:.3f} s: {reason}"
            raise SimulationError(message) from None

    def object_force(self) -> FloatArray:
        """Return the mean force (3,) [N] of all contacts on the object in the last step, in W.

        It is the change of the object's momentum without its weight.
        """
        gained = (self._object_velocity() - self._velocity) / self.time_step
        gravity: FloatArray = self.plant.gravity_field().gravity_vector()
        mass: float = self.object.body.get_mass(self.context)
        return mass * (gained - gravity)

    def support_force(self) -> FloatArray:
        """Return the force (3,) [N] of the support on the object now, without friction, in W."""
        forces = patch_forces(self._results(), {self.support})
        return np.array([0.0, 0.0, sum(force for _, _, force in forces)])

    def _object_velocity(self) -> FloatArray:
        velocity: FloatArray = self.object.body.CalcCenterOfMassTranslationalVelocityInWorld(
            self.context
        )
        return velocity

    def _note_contacts(self) -> None:
        """Free locked bodies that are touched, and note the forces on bodies beside the object."""
        if self.surroundings is None:
            return
        self._unlock_touched()
        self.forces_beside = self.surroundings.forces(self._results(), self._pushers)
        for pushed, force in self.forces_beside.items():
            self.pushes[pushed] = max(force, self.pushes.get(pushed, 0.0))

    @property
    def largest_pushes(self) -> dict[str, float]:
        """Largest force [N] on each body beside the object so far, by anyone."""
        largest: dict[str, float] = {}
        for (name, _), force in self.pushes.items():
            largest[name] = max(force, largest.get(name, 0.0))
        return largest

    def _results(self) -> ContactResults:
        results: ContactResults = self.plant.get_contact_results_output_port().Eval(self.context)
        return results

    def touch(self) -> Contacts:
        """Return what the touch sensor feels now: flat parts of contacts, in W."""
        self._unlock_touched()
        port, context = self._touch
        felt: Contacts = port.Eval(context)
        return felt

    def felt_beside(self, threshold: float) -> dict[str, int]:
        """Return the number of contacts with each body beside the object that the hand feels now.

        They have more normal force than a threshold [N].
        """
        counts: dict[str, int] = {}
        if self.surroundings is not None:
            names = self.surroundings.name_of_geometry
            for contact in link_contacts(self._results(), names, self.hand.link_of_geometry):
                if contact.normal_force > threshold:
                    name = names[contact.felt_geometry]
                    counts[name] = counts.get(name, 0) + len(contact.flat_parts())
        return counts

    def contacts(self, on: Touched = "object") -> list[LinkContact]:
        """Return the contacts of the hand with the object or the table, in Drake's order."""
        results = self._results()
        touched = self.object.geometry if on == "object" else self.table
        return link_contacts(results, {touched}, self.hand.link_of_geometry)
