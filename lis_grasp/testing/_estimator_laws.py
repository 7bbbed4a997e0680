"""Claims about an estimator under changes of its contacts, of its queries, and of the machine."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.geometry import make_pose
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.testing._estimator_subject import (
    EstimatorSubject,
    different,
    not_finite,
    values,
    wrong_sides,
)
from lis_grasp.testing._known_surfaces import (
    HALF,
    RADIUS,
    ball,
    block,
    directions,
    noisy,
    places_around,
    plate,
)
from lis_grasp.testing.check import Claims, draws_globally

LAWS = Claims()

_TURN, _MOVE, _LARGER = [0.3, -1.1, 0.7], [0.5, -0.2, 0.1], 3.0
_NOISE = {"position_noise": 0.0005, "normal_noise": 0.05}
# Of a ball with this noise, a surface may be so many standard deviations off [m].
_DEVIATIONS = 6.0
_MANY, _SECONDS = 100, 20.0  # contacts, and processor time for them and a thousand points [s]
_QUERIES = 1000
_ROUNDING = 1e-6  # relative difference of a value between two batches


@LAWS.add("turn with the contacts", "use no axis of the frame: distances and normals alone")
def _turned(of: EstimatorSubject) -> str:
    X = make_pose(Rotation.from_rotvec(_TURN).as_matrix(), np.zeros(3))
    contacts = block()
    there = Contacts(contacts.points @ X[:3, :3].T, contacts.normals @ X[:3, :3].T)
    return different(of.block, of.surface(there), X=X)


@LAWS.add("move with the contacts", "use differences of positions, no distance from the origin")
def _moved(of: EstimatorSubject) -> str:
    contacts, X = block(), make_pose(np.eye(3), np.array(_MOVE))
    there = Contacts(contacts.points + _MOVE, contacts.normals)
    return different(of.block, of.surface(there), X=X)


@LAWS.add(
    "grow with the contacts, its uncertainty in metres too",
    "measure lengths in spacings of the contacts, and return metres",
)
def _scaled(of: EstimatorSubject) -> str:
    contacts = block()
    there = Contacts(_LARGER * contacts.points, contacts.normals)
    return different(of.block, of.surface(there), factor=_LARGER)


@LAWS.add("not depend on the order of the contacts", "treat all contacts alike")
def _order_of_contacts(of: EstimatorSubject) -> str:
    contacts = block()
    order = np.random.default_rng(3).permutation(len(contacts))
    return different(of.block, of.surface(contacts.subset(order)))


@LAWS.add("make the same bytes of the same contacts", "fix the seed of every draw")
def _repeatable(of: EstimatorSubject) -> str:
    points = places_around()
    first, second = (values(of.surface(block()), points) for _ in range(2))
    wrong = first.tobytes() != second.tobytes()
    return f"two surfaces differ by up to {np.abs(first - second).max():.2g}" if wrong else ""


@LAWS.add(
    "leave the global random generator alone", "draw from numpy.random.default_rng(seed) of its own"
)
def _global_generator(of: EstimatorSubject) -> str:
    def use() -> None:
        surface = of.surface(block())
        for member in ("evaluate", "gradient", "uncertainty"):
            getattr(surface, member)(places_around(5))

    return "it drew numbers from it" if draws_globally(use) else ""


@LAWS.add("answer the same question with the same numbers", "keep no state of earlier queries")
def _earlier_queries(of: EstimatorSubject) -> str:
    surface, points = of.surface(block()), places_around()
    first = values(surface, points).copy()
    surface.gradient(points[:7])
    values(surface, 10.0 * points)
    surface.uncertainty(points[:3])
    changed = first.tobytes() != values(surface, points).tobytes()
    return "f changed after other queries" if changed else ""


@LAWS.add("give a point the same value alone as among others", "let no point depend on another")
def _batches(of: EstimatorSubject) -> str:
    points = places_around()
    together = values(of.block, points)
    alone = np.array([float(values(of.block, point)) for point in points[:20]])
    close = np.allclose(alone, together[:20], rtol=_ROUNDING, atol=_ROUNDING * np.ptp(together))
    return "" if close else f"they differ by up to {np.abs(alone - together[:20]).max():.2g}"


@LAWS.add("leave the contacts as they are", "work on a copy")
def _contacts_unchanged(of: EstimatorSubject) -> str:
    contacts = block()
    values(of.surface(contacts), places_around(5))
    same = contacts == block() and not contacts.points.flags.writeable
    return "" if same else "they were changed, or made writeable"


@LAWS.add("leave the points of a query as they are", "work on a copy")
def _queries_unchanged(of: EstimatorSubject) -> str:
    for member in ("evaluate", "gradient", "uncertainty"):
        points = places_around(20)
        getattr(of.block, member)(points)
        if not np.array_equal(points, places_around(20)):
            return f"{member} changed them"
    return ""


@LAWS.add(
    "make surfaces that can be pickled, to be sent to other processes",
    "define its class at the top of a module, and store no function in it",
)
def _pickles(of: EstimatorSubject) -> str:
    try:
        again: ImplicitSurface = pickle.loads(pickle.dumps(of.block))  # noqa: S301 - our own bytes
    except Exception as error:  # noqa: BLE001 - pickling raises anything
        return f"pickle raised {type(error).__name__}: {error}"
    points = places_around(20)
    same = np.array_equal(values(of.block, points), values(again, points))
    return "" if same else "the copy has other values"


def _usable(of: EstimatorSubject, contacts: Contacts) -> str:
    """Return how a surface fails to be usable; a surface that cannot be estimated is none."""
    try:
        surface = of.surface(contacts)
        found = not_finite(surface, np.vstack([contacts.points, places_around()]))
        bounds = np.asarray(surface.bounds)
    except EstimationError:
        return ""
    count = len(contacts)
    if not found and not (np.isfinite(bounds).all() and (bounds[0] < bounds[1]).all()):
        found = f"its bounds are {bounds.tolist()}"
    return f"from {count} contacts: {found}" if found else ""


_FEW_CURE = "widen flat boxes, use fewer neighbours, or raise lis_grasp's EstimationError"


@LAWS.add("make a finite surface of one contact", _FEW_CURE)
def _one_contact(of: EstimatorSubject) -> str:
    return _usable(of, block().subset([0]))


@LAWS.add("make finite surfaces of two to five contacts", _FEW_CURE)
def _few_contacts(of: EstimatorSubject) -> str:
    return next(filter(None, (_usable(of, ball().subset(np.arange(n))) for n in (2, 3, 4, 5))), "")


@LAWS.add("make a finite surface of contacts in one plane", _FEW_CURE)
def _one_plane(of: EstimatorSubject) -> str:
    contacts = block()
    return _usable(of, contacts.subset(contacts.normals[:, 2] > 0.5))


@LAWS.add("take contacts that were made twice", "merge contacts at one place")
def _repeated_contacts(of: EstimatorSubject) -> str:
    contacts = block()
    twice = of.surface(contacts.append(contacts))
    found = not_finite(twice, places_around())
    return found or different(of.block, twice, median=False)


@LAWS.add(
    f"be within {_DEVIATIONS:g} standard deviations of a ball that was touched with noise",
    "take the keywords position_noise [m] and normal_noise [rad], and smooth by them",
)
def _noisy_contacts(of: EstimatorSubject) -> str:
    surface = of.surface(noisy(ball(80), **_NOISE), **_NOISE)
    # A chord between eighty even contacts leaves the ball by this part of the radius.
    sagitta = 1.0 - np.cos(1.5 * np.sqrt(4.0 / 80.0))
    within = RADIUS * (1.0 - sagitta) - _DEVIATIONS * _NOISE["position_noise"]
    beyond = RADIUS / (1.0 - sagitta) + _DEVIATIONS * _NOISE["position_noise"]
    inside, outside = (values(surface, radius * directions(200)) for radius in (within, beyond))
    wrong = np.mean((inside >= 0.0) | (outside <= 0.0))
    return f"it is not in {100.0 * wrong:.0f} % of directions" if wrong > 0.02 else ""


@LAWS.add(
    "take contacts with forces, times, free space and noise of their own",
    "use the fields that it needs, and ignore the others",
)
def _contacts_with_all_fields(of: EstimatorSubject) -> str:
    contacts = block()
    count = len(contacts)
    full = Contacts(
        contacts.points,
        contacts.normals,
        forces=np.ones(count),
        fingers=("tip",) * count,
        times=np.arange(count, dtype=float),
        free_points=3.0 * HALF.max() * directions(10),
        free_radii=np.zeros(10),
        position_noise=np.full(count, _NOISE["position_noise"]),
        normal_noise=np.full(count, _NOISE["normal_noise"]),
    )
    surface = of.surface(full)
    return not_finite(surface, places_around()) or wrong_sides(surface, contacts)


@LAWS.add("distinguish both sides of a plate 4 mm thick", "let no contact act behind its surface")
def _thin_plate(of: EstimatorSubject) -> str:
    contacts = plate()
    surface = of.surface(contacts)
    flat = contacts.subset(np.abs(contacts.normals[:, 2]) > 0.5)
    depth = np.abs(flat.points[0, 2])
    inside = values(surface, flat.points - depth * flat.normals)
    outside = values(surface, flat.points + depth * flat.normals)
    wrong = (inside >= 0.0) | (outside <= 0.0)
    return f"{wrong.sum()} of {len(flat)} contacts are wrong" if wrong.any() else ""


@LAWS.add(
    f"estimate from {_MANY} contacts within {_SECONDS:g} s of processor time",
    "query neighbours by a tree, solve one system, and let no loop go over points",
)
def _many_contacts(of: EstimatorSubject) -> str:
    start = time.process_time()
    surface = of.surface(ball(_MANY))
    for member in ("evaluate", "gradient", "uncertainty"):
        method: Callable[[object], object] = getattr(surface, member)
        method(places_around(_QUERIES))
    spent = time.process_time() - start
    return f"it took {spent:.0f} s" if spent > _SECONDS else ""
