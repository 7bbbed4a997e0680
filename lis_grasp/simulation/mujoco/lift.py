"""Simulated lift in MuJoCo: a free object on a table, and a hand on a wrist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import trimesh

from lis_grasp.exceptions import SimulationError, needed_package
from lis_grasp.geometry import apply_pose, make_pose, rotate, unit
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.lifting.scene import FreeWrist, HandContact, Touched
from lis_grasp.lifting.setup import (
    WRIST_DAMPING,
    WRIST_STIFFNESS,
    LiftSetup,
    finger_gains,
    motor_inertias,
)
from lis_grasp.lifting.trial import LiftTrial
from lis_grasp.motion import OBJECT
from lis_grasp.simulation.mujoco._beside import BesideInModel
from lis_grasp.simulation.mujoco._mjcf import HAND, TIME_STEP, WRIST_JOINTS, scene_mjcf
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.typing import FloatArray

with needed_package("mujoco", "mujoco", option="the simulator mujoco"):
    import mujoco


def simulate_in_mujoco(setup: LiftSetup, accept_grasp: AcceptGrasp | None = None) -> LiftOutcome:
    """Execute one grasp on the true, free object in MuJoCo, and return whether it holds.

    Phases, control, outcome and arguments are as in the function of this name for Drake; an arm is
    not simulated.

    Contact model: points with elliptic friction cones and torsional friction, MuJoCo's soft
    constraints. The object is a union of convex pieces (`convex_pieces`), with the mass and inertia
    of its mesh; links of the hand do not collide with each other.
    """
    return LiftTrial(MujocoScene(setup, convex_pieces(setup.mesh)), setup, accept_grasp).run()


class MujocoScene:
    """A MuJoCo simulation of hand, object and table; see `LiftingScene`."""

    def __init__(self, setup: LiftSetup, pieces: Sequence[trimesh.Trimesh]) -> None:
        hand, mesh = setup.hand, setup.mesh
        self.carrier = FreeWrist(self._command_wrist)
        self._hand = hand
        self._model = model = mujoco.MjModel.from_xml_string(scene_mjcf(setup, pieces))
        self._data = mujoco.MjData(model)
        self._time_step = setup.options.time_step
        self._substeps = max(1, round(np.ceil(self._time_step / TIME_STEP - 1e-9)))
        model.opt.timestep = self._time_step / self._substeps
        self._steps = 0
        self._pull: HandContact | None = None
        self._bodies = {link: model.body(HAND + link).id for link in hand.links}
        links = {number: link for link, number in self._bodies.items()}
        bodies = enumerate(model.geom_bodyid)
        self._link_of_geom = {geom: links[body] for geom, body in bodies if body in links}
        self._object = model.body(OBJECT).id
        self._forces: dict[str, float] = {}
        self._beside: BesideInModel | None = None
        if len(setup.surroundings):
            self._beside = BesideInModel(model, setup.surroundings, set(links))
            self._beside.rest(self._data)
        free = model.joint(OBJECT)
        self._object_q = slice(free.qposadr[0], free.qposadr[0] + 7)
        self._object_v = slice(free.dofadr[0], free.dofadr[0] + 6)
        self._resting: FloatArray | None = None  # the pose at which the object is kept, (7,)
        moved = [joint for joint in hand.joints if joint.kind != "fixed"]
        self._moved = [(model.joint(HAND + joint.name), joint) for joint in moved]
        actuated = [model.joint(HAND + name) for name in hand.joint_names]
        self._finger_q = [joint.qposadr[0] for joint in actuated]
        model.dof_armature[[joint.dofadr[0] for joint in actuated]] = motor_inertias(hand)
        mujoco.mj_setConst(model, self._data)
        self._wrist_q = [model.joint(name).qposadr[0] for name in WRIST_JOINTS]
        self._lead = np.repeat(np.array(WRIST_DAMPING) / np.array(WRIST_STIFFNESS), 3)  # [s]
        self._stiffness, _ = finger_gains(hand, setup.grasp)
        self._wrist_command = np.zeros(6)
        self._center = np.asarray(mesh.center_mass)

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self._steps * self._time_step

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._steps

    def place_hand(self, displacement: FloatArray, q: FloatArray) -> None:
        """Set the palm to a displacement (6,) and the joints to q, at rest."""
        self._data.qvel[:] = 0.0
        self._data.qpos[self._wrist_q] = displacement
        for moved, joint in self._moved:
            self._data.qpos[moved.qposadr[0]] = joint.position(q)
        self._command_wrist(displacement, np.zeros(6))
        self._data.ctrl[:6] = self._wrist_command
        self.command_fingers(q, np.zeros(len(q)))
        mujoco.mj_forward(self._model, self._data)

    def _command_wrist(self, displacement: FloatArray, velocity: FloatArray) -> None:
        """Command the palm's displacement (6,) from its zero, see `WristPath`, and its rate."""
        # The servo damps the joint's velocity: a position ahead makes that the velocity's error.
        self._wrist_command = displacement + self._lead * velocity

    def command_fingers(self, q: FloatArray, efforts: FloatArray) -> None:
        """Command joint positions q, shape (J,), and efforts (J,) on top of the springs'."""
        self._data.ctrl[6:] = q + efforts / self._stiffness

    def pull(self, contact: HandContact | None) -> None:
        """Apply the force of a link on the object, and its reaction; see `LiftingScene`."""
        self._pull = contact
        self._data.xfrc_applied[:] = 0.0
        if contact is None:
            return
        for body, sign in ((self._object, 1.0), (self._bodies[contact.link], -1.0)):
            arm = contact.point - self._data.xipos[body]  # MuJoCo applies it at the centre of mass
            force = sign * contact.force
            self._data.xfrc_applied[body] = np.concatenate([force, np.cross(arm, force)])

    def rest_object(self) -> None:
        """Keep the object where it is until the hand touches it."""
        self._resting = self._data.qpos[self._object_q].copy()

    def step(self) -> None:
        """Advance by one time step.

        Raises `SimulationError` if positions or velocities are no longer finite.
        """
        self._steps += 1
        self._forces = {}
        before = self._data.ctrl[:6].copy()
        change = self._wrist_command - before
        for substep in range(1, self._substeps + 1):
            # A command that jumps once a step would shake the palm.
            self._data.ctrl[:6] = before + substep / self._substeps * change
            mujoco.mj_step(self._model, self._data)
            self._push()
            if self._beside is not None:
                self._beside.keep(self._data)
            if self._resting is not None:
                self._data.qpos[self._object_q] = self._resting
                self._data.qvel[self._object_v] = 0.0
        self._data.ctrl[:6] = self._wrist_command  # without rounding
        if not (np.isfinite(self._data.qpos).all() and np.isfinite(self._data.qvel).all()):
            raise SimulationError(f"a lift diverged at {self.time:.3f} s")
        # A step ends with poses of its start.
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        if self._resting is not None and (self.contacts() or self._is_pushed()):
            self._resting = None

    def _push(self) -> None:
        """Keep the largest forces on the bodies beside the object in this step."""
        if self._beside is not None:
            for name, force in self._beside.forces(self._data).items():
                self._forces[name] = max(force, self._forces.get(name, 0.0))

    def _is_pushed(self) -> bool:
        """Return whether a free body touches the object."""
        return self._beside is not None and self._beside.touch_object(self._data)

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions, shape (J,)."""
        return np.array(self._data.qpos[self._finger_q])

    @property
    def X_WH(self) -> FloatArray:
        """Pose of the palm, shape (4, 4)."""
        return np.asarray(self.X_WL(self._hand.base_link) @ self._hand.X_LH)

    @property
    def X_WO(self) -> FloatArray:
        """Pose of the object, shape (4, 4)."""
        X_WO = self._pose(self._object)
        X_WO[:3, 3] -= rotate(X_WO, self._center)
        return X_WO

    def poses(self) -> dict[str, FloatArray]:
        """Return the pose of every hand link and the object, each (4, 4)."""
        return {**{link: self.X_WL(link) for link in self._bodies}, OBJECT: self.X_WO}

    def contacts(self, on: Touched = "object") -> list[HandContact]:
        """Return the contacts of the hand with the object or the table, in a fixed order."""
        body = self._object if on == "object" else 0  # the world's
        pulls = [self._pull] if self._pull is not None and on == "object" else []
        merged = _merged_contacts(self._model, self._data, body, self._link_of_geom)
        return [*merged, *pulls]

    def forces_beside(self) -> dict[str, float]:
        """Return the largest forces [N] of hand and object on bodies beside it in the last step."""
        return self._forces

    def poses_beside(self) -> dict[str, FloatArray]:
        """Return the poses X_WB (4, 4) of the free bodies beside the object."""
        return {} if self._beside is None else self._beside.poses(self._data)

    def jacobian(self, link: str, p_L: FloatArray) -> FloatArray:
        """Return the Jacobian of a point p_L of a link with respect to the joints, shape (3, J).

        Joints that follow another move with it.
        """
        X_WL = self.X_WL(link)
        every = np.zeros((3, self._model.nv))
        point = apply_pose(X_WL, p_L)
        mujoco.mj_jac(self._model, self._data, every, None, point, self._bodies[link])
        columns = np.zeros((3, len(self._hand.joint_names)))
        for moved, joint in self._moved:
            columns[:, joint.index] += joint.multiplier * every[:, moved.dofadr[0]]
        return columns

    def X_WL(self, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        return self._pose(self._bodies[link])

    def _pose(self, body: int) -> FloatArray:
        return make_pose(self._data.xmat[body].reshape(3, 3), self._data.xpos[body])


def _merged_contacts(
    model: mujoco.MjModel, data: mujoco.MjData, touched: int, link_of_geom: Mapping[int, str]
) -> list[HandContact]:
    """Return the contacts that exert a force on a body, one for each of the hand, in order.

    Drake's contact patch is one for each pair of bodies; MuJoCo gives several points of it, and
    several convex pieces of the object. `link_of_geom` are the hand's bodies by number.
    """
    sums: dict[int, tuple[FloatArray, FloatArray, FloatArray, float]] = {}
    for number in range(data.ncon):
        first, second = (int(geom) for geom in data.contact.geom[number])
        if model.geom_bodyid[first] == touched:
            geom, outward = second, 1.0  # MuJoCo's normal is from the first to the second
        elif model.geom_bodyid[second] == touched:
            geom, outward = first, -1.0
        else:
            continue
        if geom not in link_of_geom:
            continue
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, number, wrench)
        if wrench[0] <= 0.0:
            continue
        frame = data.contact.frame[number].reshape(3, 3)  # its rows: the normal, two tangents
        # The force of the first body on the second.
        force = -outward * (wrench[:3] @ frame)
        point, normal, total, weight = sums.get(geom, (0.0, 0.0, 0.0, 0.0))
        sums[geom] = (
            point + wrench[0] * data.contact.pos[number],
            normal + outward * wrench[0] * frame[0],
            total + force,
            weight + wrench[0],
        )
    return [
        HandContact(link_of_geom[geom], point / weight, unit(normal), force)
        for geom, (point, normal, force, weight) in sums.items()
    ]
