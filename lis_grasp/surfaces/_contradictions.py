"""Search for the contacts that contradict all others: the least credible first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces._contact_evidence import Evidence, groups_of
from lis_grasp.surfaces._normal_signs import LEAST_MARGIN, NormalSigns
from lis_grasp.typing import FloatArray, IndexArray

SOUND, FLIPPED, WRONG_NORMAL, STRAY = range(4)
"""Verdicts: a wrong normal or a stray is left out, a flipped normal turned."""

# Log odds from which a normal is turned, more of noisy normals [1/rad], and of few contacts. From
# which a contact is left out, if there are not few.
_TURN, _TURN_NOISY, _TURN_FEW, _LEAVE_OUT = 8.0, 16.0, 4.0, 8.0
_FEW = 20
# It is lower once normals were turned: by this factor times the logarithm of their number plus 1.
_FOUND = 2.0
# What was turned is turned back at log odds above minus this.
_TURNED = 4.0
# Both are higher for more contacts: by this factor times the logarithm of their number in hundreds.
_MANY = 2.0
# A normal that no near contact mirrors so well has no right side; less of noisy normals [1/rad].
_MIRRORED, _MIRRORED_NOISY = 0.85, 1.0
# Fraction of contradicting contacts at which the search ends: too many to know what is true.
_MOST_BAD = 0.4
# The process is scaled again where contacts that are left out made it larger by this factor.
_SHRUNK = 0.75
# All signs are chosen together if this fraction is turned, or may be flipped at these log odds, and
# if that decreases the energy by so much for each normal more that it turns.
_SEVERAL, _DOUBTFUL, _GAIN = 0.05, 5.0, 5.0


def find_contradictions(
    contacts: Contacts, position: FloatArray, normal: FloatArray
) -> tuple[IndexArray, FloatArray]:
    """Return the verdict of each contact (N,), and its log odds (N,).

    Contacts are distinct, of noise (N,) [m] and (N,) [rad]. The log odds are those of the likeliest
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
        self._doubtful = 0.0  # fraction of normals

    def run(self) -> None:
        """Turn or leave out what contradicts most, again and again."""
        self._run_each()
        turned = float(np.mean(self.verdicts == FLIPPED))
        # Of few contacts, one that is turned is no sign of several.
        many = len(self.verdicts) >= _FEW
        several = max(turned, self._doubtful if many else 0.0) > _SEVERAL
        if several and turned * len(self.verdicts) != 1.0 and self._turn_together(turned):
            self._run_each()

    def _run_each(self) -> None:
        turns = np.zeros(len(self.odds), dtype=np.intp)
        mirrored = _MIRRORED - _MIRRORED_NOISY * self._noise[1]
        while True:
            flipped, stray = self._evidence.log_odds()
            self._doubtful = float(np.mean(flipped > _DOUBTFUL))
            turn = self._turn[self._kept]
            turned = self.verdicts[self._kept] == FLIPPED
            stray -= np.where(self._evidence.empty, _LEAVE_OUT, self._leave_out)
            as_measured = np.where(turned, -flipped, flipped) - turn
            self.odds[self._kept] = np.maximum(as_measured, stray)
            flipped -= np.where(turned, -_TURNED, turn - _FOUND * np.log1p(turned.sum()))
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

    def _turn_together(self, turned: float) -> bool:
        """Turn several contacts at once to the likeliest signs; return whether they are."""
        energy = NormalSigns.of(self._evidence)
        signs, margin = energy.likeliest()
        if margin < LEAST_MARGIN and turned <= _SEVERAL:
            return False
        gain = energy.energy(np.ones(len(signs))) - energy.energy(signs)
        before = self.verdicts[self._kept] == FLIPPED
        more = np.count_nonzero(before ^ (signs < 0.0)) - np.count_nonzero(before)
        if np.all(signs > 0.0) or gain < _GAIN * more:
            return False
        self._flip(np.flatnonzero(signs < 0.0))
        return True

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
