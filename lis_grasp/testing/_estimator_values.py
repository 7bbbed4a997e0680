"""Claims about the form and the values of an estimator's surface."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.meshing import extract_mesh
from lis_grasp.testing._estimator_subject import (
    ASIDE,
    EstimatorSubject,
    kind_of_value,
    not_finite,
    values,
    wrong_sides,
)
from lis_grasp.testing._known_surfaces import (
    HALF,
    RADIUS,
    ball,
    block,
    block_distance,
    directions,
    places_around,
)
from lis_grasp.testing.check import Claims, refused

CLAIMS = Claims()

_MEMBERS = ("evaluate", "gradient", "uncertainty", "bounds")
_SHAPES: tuple[tuple[int, ...], ...] = ((), (1,), (0,), (4, 3), (2, 0, 5))
# A crossing is wanted within this length of an exact contact [m].
_CROSSING = 0.0005
# Inside of the ball and outside of it, in radii: a polyhedron about forty contacts is within.
_WITHIN, _BEYOND = 0.75, 1.4
# Step of finite differences [m], the error of a slope in slopes, and how many points may have a
# kink or a jump near them.
_STEP, _SLOPE, _KINKS = 1e-6, 0.02, 0.1
_OUTWARD = 0.8  # least cosine between a gradient and the normal of its contact
_FAR = 10.0  # distance at which a surface must still have values [m]
_WIDE = 2.0  # most by which bounds exceed the box of the contacts, in its longest side
_VOLUME = 0.25  # most by which the volume of the ball is wrong


@CLAIMS.add(f"return a surface with {', '.join(_MEMBERS)}", "add what is missing")
def _members(of: EstimatorSubject) -> str:
    missing = [name for name in _MEMBERS if not hasattr(of.ball, name)]
    return f"its {type(of.ball).__name__} has no {' and no '.join(missing)}" if missing else ""


def _wrong_shape(of: EstimatorSubject, member: str, *last: int) -> str:
    for shape in _SHAPES:
        found = np.shape(getattr(of.ball, member)(np.full((*shape, 3), 0.01)))
        if found != (*shape, *last):
            return f"for points of shape {(*shape, 3)} it returned shape {found}"
    return ""


@CLAIMS.add("evaluate points of any shape (..., 3) to shape (...)", "reduce the last axis alone")
def _shape_of_values(of: EstimatorSubject) -> str:
    return _wrong_shape(of, "evaluate")


@CLAIMS.add("return gradients of the shape of the points, (..., 3)", "keep the leading axes")
def _shape_of_gradients(of: EstimatorSubject) -> str:
    return _wrong_shape(of, "gradient", 3)


@CLAIMS.add("return uncertainties of shape (...)", "return one number for each point")
def _shape_of_uncertainties(of: EstimatorSubject) -> str:
    return _wrong_shape(of, "uncertainty")


@CLAIMS.add("return numbers of type float64", "convert results by numpy.asarray(x, dtype=float)")
def _type_of_numbers(of: EstimatorSubject) -> str:
    for member in _MEMBERS[:3]:
        found = getattr(of.ball, member)(places_around(5))
        if np.asarray(found).dtype != np.float64 or isinstance(found, list | tuple):
            return f"{member} returned {kind_of_value(found)}"
    return ""


@CLAIMS.add("take lists of points like arrays", "begin with numpy.asarray(points, dtype=float)")
def _lists_of_points(of: EstimatorSubject) -> str:
    points = np.round(1e3 * places_around(5)).astype(int)  # whole metres, too
    for member in _MEMBERS[:3]:
        method = getattr(of.ball, member)
        if not np.array_equal(method(points.tolist()), method(points.astype(float))):
            return f"{member} of a list of whole numbers differs from that of an array"
    return ""


@CLAIMS.add(
    "have bounds of shape (2, 3), the lowest corner first", "stack the corners, lowest first"
)
def _form_of_bounds(of: EstimatorSubject) -> str:
    bounds = np.asarray(of.block.bounds)
    if bounds.shape != (2, 3):
        return f"they have shape {bounds.shape}"
    return "" if (bounds[0] < bounds[1]).all() else f"they are {bounds.tolist()}"


@CLAIMS.add("have bounds that hold every contact with a margin", "enlarge the box of the contacts")
def _bounds_hold_the_contacts(of: EstimatorSubject) -> str:
    bounds, points = np.asarray(of.block.bounds), block().points
    outside = ((points <= bounds[0]) | (points >= bounds[1])).any(axis=1)
    return f"{outside.sum()} of {len(points)} contacts are not inside" if outside.any() else ""


@CLAIMS.add(
    "have bounds near the contacts", f"enlarge their box by less than {_WIDE:g} times its size"
)
def _bounds_are_near(of: EstimatorSubject) -> str:
    excess = np.abs(np.asarray(of.block.bounds) - block().bounds).max() / block().extent
    return f"they exceed the contacts by {excess:.1f} times their size" if excess > _WIDE else ""


@CLAIMS.add("be negative inside of a touched ball", "change the sign of evaluate")
def _negative_inside(of: EstimatorSubject) -> str:
    found = values(of.ball, np.vstack([np.zeros(3), _WITHIN * RADIUS * directions(60)]))
    return f"{np.sum(found >= 0.0)} of {len(found)} places are not" if (found >= 0.0).any() else ""


@CLAIMS.add("be positive outside of a touched ball", "change the sign of evaluate")
def _positive_outside(of: EstimatorSubject) -> str:
    corners = trimesh.bounds.corners(np.asarray(of.ball.bounds))
    found = values(of.ball, np.vstack([corners, _BEYOND * RADIUS * directions(60)]))
    return f"{np.sum(found <= 0.0)} of {len(found)} places are not" if (found <= 0.0).any() else ""


@CLAIMS.add(
    f"be positive {1e3 * ASIDE:g} mm outside of every contact and negative inside",
    "let the surface pass through the contacts, with their normals outward",
)
def _sides_of_contacts(of: EstimatorSubject) -> str:
    return wrong_sides(of.block, block())


@CLAIMS.add(
    f"have its zero set within {1e3 * _CROSSING:g} mm of exact contacts",
    "interpolate the contacts, or trust them more without noise",
)
def _zero_set_at_contacts(of: EstimatorSubject) -> str:
    at_ball = wrong_sides(of.ball, ball(), _CROSSING)
    return at_ball or wrong_sides(of.block, block(), _CROSSING)


@CLAIMS.add(
    "have the gradient that finite differences of evaluate have",
    "derive gradient from the same formula as evaluate",
)
def _gradient_is_the_slope(of: EstimatorSubject) -> str:
    points = places_around()
    points = points[np.abs(block_distance(points)) < HALF.min()]
    steps = _STEP * np.eye(3)
    slopes = (
        values(of.block, points[:, None] + steps) - values(of.block, points[:, None] - steps)
    ) / (2.0 * _STEP)
    errors = np.linalg.norm(np.asarray(of.block.gradient(points)) - slopes, axis=1)
    wrong = errors > _SLOPE * np.maximum(np.linalg.norm(slopes, axis=1), np.median(np.abs(slopes)))
    share = float(np.mean(wrong))
    return f"{100.0 * share:.0f} % of {len(points)} gradients differ" if share > _KINKS else ""


@CLAIMS.add("have gradients that point outward at the contacts", "change the sign of gradient")
def _gradient_points_outward(of: EstimatorSubject) -> str:
    contacts = ball()
    found = np.asarray(of.ball.gradient(contacts.points))
    lengths = np.linalg.norm(found, axis=1)
    cosines = np.sum(found * contacts.normals, axis=1) / np.maximum(lengths, 1e-300)
    wrong = cosines < _OUTWARD
    return f"{wrong.sum()} of {len(contacts)} do not" if wrong.any() else ""


@CLAIMS.add("be finite everywhere", "give far points, contacts and centres a value, too")
def _finite_everywhere(of: EstimatorSubject) -> str:
    far = _FAR * directions(20)
    for contacts, surface in ((ball(), of.ball), (block(), of.block)):
        points = np.vstack([np.zeros(3), contacts.points, places_around(), far])
        found = not_finite(surface, points)
        if found:
            return found
    return ""


@CLAIMS.add("have uncertainties of at least 0", "return a standard deviation, not its square root")
def _uncertainty_not_negative(of: EstimatorSubject) -> str:
    found = np.asarray(of.block.uncertainty(np.vstack([block().points, places_around()])))
    return f"the least is {found.min():.3g} m" if found.min() < 0.0 else ""


@CLAIMS.add(
    "be less certain where nothing was touched",
    "let the uncertainty grow with the distance from contacts",
)
def _uncertainty_grows(of: EstimatorSubject) -> str:
    whole = ball()
    touched = whole.subset(whole.points[:, 2] < 0.0)
    surface = of.surface(touched)
    near, far = (
        float(np.median(np.asarray(surface.uncertainty(points))))
        for points in (touched.points, whole.points[whole.points[:, 2] > 0.6 * RADIUS])
    )
    return "" if far > near else f"it is {near:.2g} m at contacts, {far:.2g} m on the other side"


@CLAIMS.add("have a closed mesh of about the touched volume", "see the claims on signs and bounds")
def _mesh_of_a_ball(of: EstimatorSubject) -> str:
    mesh = extract_mesh(of.ball, resolution=RADIUS / 8.0)
    if not mesh.is_watertight:
        return "the mesh of a ball is open"
    ratio = float(mesh.volume) / (4.0 / 3.0 * np.pi * RADIUS**3)
    return f"that of a ball is {ratio:.2f} times the true one" if abs(ratio - 1.0) > _VOLUME else ""


@CLAIMS.add("refuse points that are not of shape (..., 3)", "raise an error if shape[-1] != 3")
def _points_of_another_shape(of: EstimatorSubject) -> str:
    for shape in ((2,), (3, 4)):
        if not refused(lambda shape=shape: of.ball.evaluate(np.zeros(shape))):  # type: ignore[misc]
            return f"evaluate took points of shape {shape}"
    return ""


@CLAIMS.add("refuse points that are not finite", "raise an error, or use scipy's trees, which do")
def _points_not_finite(of: EstimatorSubject) -> str:
    for wrong in (np.nan, np.inf):
        if not refused(lambda wrong=wrong: of.ball.evaluate([[0.0, wrong, 0.0]])):  # type: ignore[misc]
            return f"evaluate took a coordinate that is {wrong}"
    return ""


@CLAIMS.add("refuse to estimate from no contacts", "raise an error if len(contacts) is 0")
def _no_contacts(of: EstimatorSubject) -> str:
    def use() -> object:
        return values(of.surface(Contacts.empty()), np.zeros((1, 3)))

    return "" if refused(use) else "it made a surface of nothing"
