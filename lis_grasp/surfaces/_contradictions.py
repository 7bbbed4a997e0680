"""Search for the contacts that contradict all others: the least credible first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces._contact_evidence import Evidence, groups_of
from lis_grasp.surfaces._normal_signs import NormalSigns
from lis_grasp.typing import FloatArray, IndexArray

SOUND, FLIPPED, WRONG_NORMAL, STRAY = range(4)
"""Verdicts: a wrong normal or a stray is left out, a flipped normal turned."""

# Log odds from which a normal is turned, more of noisy normals [1/rad], and of few contacts. From
# which a contact is left out, if there are not few.
_TURN, _TURN_NOISY, _TURN_FEW, _LEAVE_OUT = 5.5, 16.0, 4.0, 8.0
_FEW = 20
# It is lower once several were turned: by this factor times the logarithm of their number.
_FOUND = 2.0
# Both are higher for more contacts: by this factor times the logarithm of their number in hundreds.
_MANY = 2.0
# A normal that no near contact mirrors so well has no right side; less of noisy normals [1/rad].
_MIRRORED, _MIRRORED_NOISY = 0.85, 1.0
# Fraction of contradicting contacts at which the search ends: too many to know what is true.
_MOST_BAD = 0.4
# The process is scaled again where contacts that are left out made it larger by this factor.
_SHRUNK = 0.75
# All signs are chosen together if so large a fraction of normals is likelier flipped than not, more
# of noisy normals [1/rad].
_SEVERAL, _SEVERAL_NOISY = 0.2, 0.6


def find_contradictions(
    contacts: Contacts, position: FloatArray, normal: FloatArray
) -> tuple[IndexArray, FloatArray]:
    """Return the verdict of each contact (N,), and its log odds (N,).

    Contacts are distinct, of noise (N,) [m] and (N,) [rad]. The log odds belong to the likeliest
    contradiction, less those needed to believe it: above 0 for contacts that are not sound.
    """
    verdicts, odds = np.full(len(contacts), SOUND), np.full(len(contacts), -np.inf)
    for rows in groups_of(contacts):
        more = _MANY * max(np.log(len(contacts) / 100.0), 0.0)
        search = _Search(contacts.subset(rows), position[rows], normal[rows], more)
        search.run()
        verdicts[rows], odds[rows] = search.verdicts, search.odds
    return verdicts, odds


class _Search:
    """State of the search in contacts, at least two places."""

    def __init__(
        self, contacts: Contacts, position: FloatArray, normal: FloatArray, more: float
    ) -> None:
        count = len(contacts)
        self.verdicts, self.odds = np.full(count, SOUND), np.full(count, -np.inf)
        self._contacts, self._noise = contacts, np.stack([position, normal])
        self._turn = _TURN + more + _TURN_NOISY * normal + (_TURN_FEW if count < _FEW else 0.0)
        self._leave_out = _LEAVE_OUT + more if count >= _FEW else np.inf
        self._kept = np.arange(count)
        self._evidence = Evidence.of(contacts, position, normal)

    def run(self) -> None:
        """Turn or leave out what contradicts most, again and again."""
        flipped, _ = self._evidence.log_odds()
        several = _SEVERAL + _SEVERAL_NOISY * float(np.median(self._noise[1]))
        if len(flipped) >= _FEW and np.mean(flipped > 0.0) > several:
            signs, _ = NormalSigns.of(self._evidence).likeliest()
            self._flip(np.flatnonzero(signs < 0.0))
        turns = np.zeros(len(self.odds), dtype=np.intp)
        mirrored = _MIRRORED - _MIRRORED_NOISY * self._noise[1]
        while True:
            flipped, stray = self._evidence.log_odds()
            turn = self._turn[self._kept]
            turned = self.verdicts[self._kept] == FLIPPED
            stray -= np.where(self._evidence.empty, _LEAVE_OUT, self._leave_out)
            as_measured = np.where(turned, -flipped, flipped) - turn
            self.odds[self._kept] = np.maximum(as_measured, stray)
            flipped -= np.where(turned, 0.0, turn - _FOUND * np.log(max(turned.sum(), 1)))
            flipped[turns[self._kept] > 1] = -np.inf
            worst = int(np.argmax(np.maximum(flipped, stray)))
            bad = np.mean(self.verdicts != SOUND)
            if max(flipped[worst], stray[worst]) <= 0.0 or bad > _MOST_BAD:
                return
            row = self._kept[worst]
            if flipped[worst] <= stray[worst]:
                self._leave(worst, STRAY)
            elif self._evidence.most_mirrored(worst) < mirrored[row]:
                self._leave(worst, WRONG_NORMAL)
            else:
                turns[row] += 1
                self._flip(np.array([worst]))

    def _flip(self, which: IndexArray) -> None:
        self._evidence.targets[which, 1:] *= -1.0
        rows = self._kept[which]
        self.verdicts[rows] = np.where(self.verdicts[rows] == FLIPPED, SOUND, FLIPPED)

    def _leave(self, i: int, verdict: int) -> None:
        self.verdicts[self._kept[i]] = verdict
        self._kept = np.delete(self._kept, i)
        self._evidence = self._evidence.without(i)
        among = self._evidence.distances
        if among[np.isfinite(among)].max() < _SHRUNK:
            rest = self._contacts.subset(self._kept)
            rest = replace(rest, normals=self._evidence.targets[:, 1:])
            self._evidence = Evidence.of(rest, *self._noise[:, self._kept])
