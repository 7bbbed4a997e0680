"""What became of an object that was to be placed: reasons, and one line."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from types import MappingProxyType
from typing import Any

PLACE_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "placed": "the object stands where it was planned",
        "fallen": "the object fell, rolled, or leans: make more touches (`touches`)",
        "turned": "the object stands, but turned by more than 5 degrees from the plan: make more"
        " touches (`touches`)",
        "moved": "the object stands, but more than 5 mm from the planned place: make more touches"
        " (`touches`)",
        "collided": "the hand, or the object in it, pushed a wall or another body with more than"
        " 2 N: make room, or make more touches (`touches`)",
        "not_reached": "the hand did not arrive above the place: make room",
        "not_released": "the opened hand still touched the object after it had retreated: try"
        " another hand, or a place with more room",
        "lost": "the object left the hand on the way to its place: try a smaller `mass`",
        "not_held": "the lift failed, so that nothing was placed",
        "no_place": "no place is free for the object and the hand that holds it: make room",
        "diverged": "the simulation failed: try another `seed`",
    }
)
"""A sentence for every reason of `PlaceOutcome`."""


def place_lines(report: Mapping[str, Any]) -> list[str]:
    """Return whether an object was placed, or why not, in a line; no line for others."""
    facts = report.get("place")
    if facts is None:
        return []
    if not facts["placed"]:
        reason = facts["reason"]
        return [f"not placed: {PLACE_REASONS.get(reason, reason)}"]
    errors = f"{1e3 * facts['moved']:.1f} mm and {degrees(facts['turned']):.1f} deg"
    gaps = facts["planned"]["gaps"]
    apart = ", ".join(f"{1e3 * gap:.0f} mm from {name}" for name, gap in gaps.items())
    return [f"placed    {errors} from the planned pose{f'; planned {apart}' if apart else ''}"]
