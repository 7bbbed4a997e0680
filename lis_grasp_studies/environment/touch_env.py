"""Environment: touch an unseen object with a ball, say where it is solid or how to grasp it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, ClassVar, Literal, get_args

import gymnasium
import numpy as np
from gymnasium import spaces

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import STEP_FRACTION, Workspace
from lis_grasp.grasping.force_closure import is_force_closure
from lis_grasp.probing.ball_prober import BallProber
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import MeshTree, winding_numbers
from lis_grasp.typing import FloatArray
from lis_grasp_studies.test_objects.salted import MIXED_FAMILIES, salted_shape

Answer = Literal["occupancy", "grasp"]

SALT = "touch"
"""Of the objects: others than those of the benchmark."""

_TIP = 0.006  # radius of the ball [m]
_BOX = 1.2  # side of the box of queries and targets, in sizes
_OFF = 0.05  # distance of a grasp's point from the true surface that is permitted, in sizes
_FRICTION, _TORSION = 0.7, 0.005  # of the soft fingers of a grasp: 1, and [m]
_CACHED = 512  # objects
_DOWN = np.array([0.0, 0.0, -1.0])


class TouchEnv(gymnasium.Env):
    """Touches of an object of which place and size are known, with an answer before each.

    Positions are from the centre of the object, in half its size. An episode has `touches` probes.

    Observation, a dictionary:

    - ``contacts`` (touches, 6): position and outward normal, 0 where there is none.
    - ``touched`` (touches,): 1 for a probe that touched.
    - ``queries`` (queries, 3): where the answer is wanted; absent for grasps.

    Action, a dictionary:

    - ``touch`` (6,): a point on the ball's line, and the direction of its motion, not normalised.
      The ball begins outside of the object.
    - ``answer``: for ``"occupancy"`` the probability (queries,) that each query is inside; for
      ``"grasp"`` the points (2, 3) of two fingers.

    Reward: for ``"occupancy"`` minus the mean squared error of each answer (Brier 1950); for
    ``"grasp"`` 1 after the last touch if both points are on the surface and two fingers with
    friction have force closure there, else 0.

    Parameters
    ----------
    answer
        What is wanted.
    touches
        Probes of an episode.
    queries
        Number of queries.
    objects
        Objects of `SALT`, of which each episode draws one.

    Raises
    ------
    InvalidOptionError
        If an option is out of range.

    Examples
    --------
    >>> env = gymnasium.make("lis_grasp/Touch-v0", touches=5)
    >>> observation, info = env.reset(seed=0)
    >>> observation["contacts"].shape
    (5, 6)
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        *,
        answer: Answer = "occupancy",
        touches: int = 20,
        queries: int = 64,
        objects: int = 600,
    ) -> None:
        if answer not in get_args(Answer):
            raise InvalidOptionError.not_one_of("answer", answer, get_args(Answer))
        require_at_least(1, touches=touches, queries=queries, objects=objects)
        self.answer, self._touches, self._objects = answer, touches, objects
        self._queries = queries if answer == "occupancy" else 0
        observed: dict[str, spaces.Space[Any]] = {
            "contacts": spaces.Box(-2.0, 2.0, (touches, 6), np.float64),
            "touched": spaces.MultiBinary(touches),
        }
        if self._queries:
            observed["queries"] = spaces.Box(-_BOX, _BOX, (queries, 3), np.float64)
            wanted = spaces.Box(0.0, 1.0, (queries,), np.float64)
        else:
            wanted = spaces.Box(-_BOX, _BOX, (2, 3), np.float64)
        touch = spaces.Box(-1.0, 1.0, (6,), np.float64)
        self.observation_space = spaces.Dict(observed)
        self.action_space = spaces.Dict({"touch": touch, "answer": wanted})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Draw an object; ``options={"number": N}`` names one of `SALT`."""
        super().reset(seed=seed)
        number = (options or {}).get("number", int(self.np_random.integers(self._objects)))
        self._shape, self._prober, self._tree = _object(number)
        self.half = 0.5 * self._shape.size
        self.outcomes: list[ProbeOutcome] = []
        self._contacts = np.zeros((self._touches, 6))
        self._touched = np.zeros(self._touches, dtype=np.int8)
        self.places = self.np_random.uniform(-_BOX, _BOX, (self._queries, 3))
        self._inside = np.zeros(0)
        if self._queries:
            mesh = self._shape.mesh
            solid = winding_numbers(self.half * self.places, mesh.vertices, mesh.faces)
            self._inside = (solid > 0.5).astype(np.float64)
        return self._observation(), {"object": self._shape.name}

    def step(
        self, action: dict[str, Any]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Touch, and score the answer, which was given before this touch."""
        outcome = self._prober.probe(self._probe(np.asarray(action["touch"], np.float64)))
        last = len(self.outcomes)
        self.outcomes.append(outcome)
        if outcome.status == "touched":
            found = outcome.contacts
            self._contacts[last] = np.hstack([found.points[0] / self.half, found.normals[0]])
            self._touched[last] = 1
        ended = len(self.outcomes) == self._touches
        reward = self._score(np.asarray(action["answer"], np.float64), ended)
        info = {"object": self._shape.name, "status": outcome.status}
        return self._observation(), reward, ended, False, info

    @property
    def space(self) -> Workspace:
        """What is known of the object before the first touch [m]."""
        size, low = self._shape.size, float(self._shape.mesh.bounds[0, 2])
        return Workspace(STEP_FRACTION * size, np.zeros(3), size, low, tip_radius=_TIP)

    @property
    def contacts(self) -> Contacts:
        """The contacts so far [m]."""
        rows = self._contacts[self._touched.astype(bool)]
        return Contacts(self.half * rows[:, :3], rows[:, 3:])

    def action_of(self, probe: Probe | None, answer: FloatArray) -> dict[str, Any]:
        """Return the action whose line is that of a probe [m], with an answer."""
        if probe is None:
            probe = Probe(np.zeros(3), _DOWN, 0.0, 0.0)
        place = np.clip(probe.target / (_BOX * self.half), -1.0, 1.0)
        return {"touch": np.hstack([place, probe.direction]), "answer": answer}

    def _probe(self, touch: FloatArray) -> Probe:
        """Return the probe of an action, from outside of the object's ball and through it."""
        length = float(np.linalg.norm(touch[3:]))
        along = touch[3:] / length if length > 0.0 else _DOWN
        target, space = _BOX * self.half * touch[:3], self.space
        standoff = float(space.approach_distance(target, along)) + 2.0 * _TIP
        return Probe(target, along, standoff, overshoot=space.size)

    def _observation(self) -> dict[str, Any]:
        seen: dict[str, Any] = {"contacts": self._contacts.copy(), "touched": self._touched.copy()}
        return seen | ({"queries": self.places.copy()} if self._queries else {})

    def _score(self, answer: FloatArray, ended: bool) -> float:
        if self.answer == "occupancy":
            return -float(np.mean((answer - self._inside) ** 2))
        return float(ended and self._holds(self.half * answer.reshape(2, 3)))

    def _holds(self, points: FloatArray) -> bool:
        """Return whether two fingers at points (2, 3) [m] touch the surface and hold it."""
        squares, faces, nearest = self._tree.nearest(points)
        if np.sqrt(squares.max()) > _OFF * self._shape.size:
            return False
        normals = np.asarray(self._shape.mesh.face_normals)[faces]
        return is_force_closure(
            nearest, normals, friction=_FRICTION, model="soft_finger", torsion=_TORSION
        )


@lru_cache(maxsize=_CACHED)
def _object(number: int) -> tuple[Shape, BallProber, MeshTree]:
    """Return an object, its prober and its tree."""
    shape = salted_shape(SALT, number, MIXED_FAMILIES)
    low = float(shape.mesh.bounds[0, 2])
    return shape, BallProber(shape.mesh, radius=_TIP, support_height=low), MeshTree(shape.mesh)
