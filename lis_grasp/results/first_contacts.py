"""Contacts of an exploration, refused if there is nothing to estimate."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.exploration import Exploration
from lis_grasp.exploration.workspace import lowest_tip
from lis_grasp.stages.scenario import Scenario


def touched_contacts(folder: Path, exploration: Exploration, scenario: Scenario) -> Contacts:
    """Return the contacts that an exploration wrote to a folder.

    Raises `EstimationError` if there are none, or the object is too low for fingertips.
    """
    contacts = Contacts.load(folder / "contacts.ply")
    height, lowest = float(scenario.truth.shape.mesh.extents[2]), lowest_tip(0.0)
    if len(contacts):
        top = contacts.bounds[1, 2] - scenario.agent.support_height
        if top <= lowest:
            raise EstimationError(
                f"the object is {1e3 * top:.2g} mm high where it was touched, too low for"
                " fingertips on a table: turn it so that it stands higher"
            )
        return contacts
    why = "check that the region contains the object and that the hand gets there"
    blocked = Counter(o.reason for o in exploration.outcomes if o.status == "blocked")
    if blocked:
        reason, count = blocked.most_common(1)[0]
        why = f"{count} were blocked, as {reason}; {why}"
    is_low = height < 1.001 * lowest  # STL is in single precision
    if scenario.task.known.region is not None and is_low:
        why = (
            f"the object is {1e3 * height:.2g} mm high, and fingertips that search for it stay"
            f" {1e3 * lowest:.2g} mm above the table: an object so thin must be at a known place"
        )
    raise EstimationError(
        f"no contact was made in {len(exploration.outcomes)} probes, so that there is nothing to"
        f" estimate: {why}"
    )
