"""Memory of a touch sensor: contacts so far, links in touch, and free space that was swept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.observations import new_contacts
from lis_grasp.exploration.touch_detection import TouchDetection
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.probing.course import FREE_POINT_SPACING
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray, IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class TouchRecord(Record):
    """Everything that a touch sensor remembers, in E. It never changes: methods return others."""

    contacts: Contacts = field(default_factory=Contacts.empty)  # with free space up to the last
    touching: tuple[tuple[str, FloatArray], ...] = ()  # links, and where each was recorded last
    # Centres and radii of free balls (K, 4), since the last touch or the end of listening.
    swept: tuple[FloatArray, ...] = ()
    cells: frozenset[tuple[int, ...]] = frozenset()  # of free balls, so that none is repeated
    looked: FloatArray | None = None  # centres (B, 3) of the hand's balls at the last look
    was_reset: bool = False

    def begun(
        self,
        links: Sequence[str],
        points: Sequence[FloatArray],
        forces: Sequence[float],
        detection: TouchDetection,
    ) -> tuple[TouchRecord, list[int]]:
        """Return the record with the links that touch now, and which contacts are to be added.

        A contact of a link is added when it begins to touch, or has slid by the detection's
        spacing. Given are the contacts with more than the released force.
        """
        spacing = np.inf if detection.spacing is None else detection.spacing
        known, touching = dict(self.touching), dict[str, FloatArray]()
        added = []
        for k, (link, point, force) in enumerate(zip(links, points, forces, strict=True)):
            last = known.get(link)
            far = last is None or np.linalg.norm(point - last) >= spacing
            if far and force > detection.threshold:
                added.append(k)
                touching[link] = point
            elif last is not None:
                touching.setdefault(link, last)
        if not added and touching.keys() == known.keys():
            return self, []
        return replace(self, touching=tuple(touching.items())), added

    def with_contacts(self, found: Contacts) -> TouchRecord:
        """Return the record with contacts that are no duplicates, and the space swept so far."""
        found = found.subset(new_contacts(self.contacts, found))
        record = self.with_free_space()
        return replace(record, contacts=record.contacts.append(found))

    def with_free_space(self) -> TouchRecord:
        """Return the record with the space swept so far in its contacts."""
        if not self.swept:
            return self
        balls = np.vstack(self.swept)
        free = replace(Contacts.empty(), free_points=balls[:, :3], free_radii=balls[:, 3])
        return replace(self, contacts=self.contacts.append(free), swept=())

    def idle(self) -> TouchRecord:
        """Return the record while the sensor does not listen."""
        if not self.touching and self.looked is None:
            return self
        return replace(self.with_free_space(), touching=(), looked=None)

    def looked_at(self, centers: FloatArray, radii: FloatArray, space: Workspace) -> TouchRecord:
        """Return the record after a look at balls in the hand, centres (B, 3) and radii (B,) [m].

        Balls that overlap the object's space are added, where none like them has been.
        """
        if self.looked is not None:
            moved = np.linalg.norm(centers - self.looked, axis=1).max(initial=0.0)
            if moved < FREE_POINT_SPACING:
                return self
        apart = np.linalg.norm(centers - space.center, axis=1)
        near: IndexArray = np.flatnonzero(apart < space.radius + radii)
        cells = np.round(centers / FREE_POINT_SPACING).astype(int)
        of_ball = {int(ball): (int(ball), *cells[ball].tolist()) for ball in near}
        new = [ball for ball, cell in of_ball.items() if cell not in self.cells]
        swept = self.swept
        if new:
            swept = (*swept, np.column_stack([centers[new], radii[new]]))
        added = {of_ball[ball] for ball in new}
        return replace(self, swept=swept, cells=self.cells | added, looked=centers)
