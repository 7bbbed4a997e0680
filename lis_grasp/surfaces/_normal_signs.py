"""Signs of the normals of contacts: the sides that are likeliest together.

With the axes of the normals known, the energy of the process is quadratic in their signs s, and so
is the sum of mirrored neighbours (`Evidence`): an Ising model. Its minimum is searched from several
starts, by flips of single contacts and of groups.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces._contact_evidence import Evidence, groups_of
from lis_grasp.typing import FloatArray, IndexArray

LEAST_MARGIN = 1.6
"""Difference of energies to other signs from which signs are known."""

# Weights of mirrored neighbours, of chords, and of free space at a contact.
_MIRRORED, _CHORDS, _FREE_SPACE = 3.0, 6.0, 40.0
# Fraction of the increase for one other sign.
_OF_ONE = 0.25
# Least decrease of a flip.
_LEAST = 1e-9


def likeliest_signs(
    contacts: Contacts, position: FloatArray, normal: FloatArray
) -> tuple[FloatArray, float]:
    """Return the likeliest signs of normals (N,), and their margin; -inf if nothing shows them.

    The margin is the least difference of energies to other signs. Noise (N,) is in [m] and [rad].
    """
    signs, margins = np.ones(len(contacts)), []
    for rows in groups_of(contacts):
        evidence = Evidence.of(contacts.subset(rows), position[rows], normal[rows])
        signs[rows], margin = NormalSigns.of(evidence).likeliest()
        margins.append(margin)
    return signs, min(margins, default=-np.inf)


@dataclass(slots=True, eq=False)
class NormalSigns:
    """Energy F(s) = 2N log(s^T J s + 2 h.s + c) - s^T M s - 2 b.s of signs. Made by `of`."""

    couplings: FloatArray  # (N, N) J
    field: FloatArray  # (N,) h: far away is outside
    constant: float  # c
    mirrored: FloatArray  # (N, N) M, 0 on the diagonal
    bias: FloatArray  # (N,) b: free space is outside
    outward: FloatArray  # (N,) signs of normals that point away from the middle

    @classmethod
    def of(cls, evidence: Evidence) -> NormalSigns:
        """Return the energy of signs of contacts, relative to their normals."""
        normals = evidence.targets[:, 1:]
        slopes = np.einsum("ia,iajb->ijb", normals, evidence.precision[:, 1:], optimize=True)
        pairs, chords, weights = evidence.pairs()
        mirrored = (_MIRRORED * pairs + _CHORDS * chords) * weights
        from_middle = evidence.offsets[0] - np.median(evidence.offsets[0], axis=0)
        return cls(
            couplings=np.einsum("ija,ja->ij", slopes[:, :, 1:], normals),
            field=-slopes[:, :, 0].sum(axis=1),
            constant=float(evidence.precision[:, 0, :, 0].sum()),
            mirrored=0.5 * (mirrored + mirrored.T),
            outward=np.where(np.sum(from_middle * normals, axis=1) < 0.0, -1.0, 1.0),
            bias=0.5 * _FREE_SPACE * evidence.facing(),
        )

    def energy(self, signs: FloatArray) -> float:
        """Return F of signs (N,), each 1 or -1."""
        quadratic = signs @ (self.couplings @ signs + 2.0 * self.field) + self.constant
        others = signs @ (self.mirrored @ signs + 2.0 * self.bias)
        return float(2.0 * len(signs) * np.log(quadratic) - others)

    def likeliest(self) -> tuple[FloatArray, float]:
        """Return the likeliest signs (N,), and their margin.

        It is how much larger F is of the opposite signs, or a fraction of that for another sign of
        any one contact.
        """
        merged, groups = self._merged()
        found = [self._descend(start, groups) for start in (self.outward, merged, -merged)]
        found.append(self._descend(-min(found, key=self.energy), groups))
        best = min(found, key=self.energy)
        single = min(map(self.energy, best - 2.0 * np.diag(best))) - self.energy(best)
        return best, min(self.energy(-best) - self.energy(best), _OF_ONE * single)

    def _descend(self, signs: FloatArray, groups: list[IndexArray]) -> FloatArray:
        """Return signs that no flip of a contact or group improves."""
        signs = signs.copy()
        single = np.diag(self.couplings)
        while True:
            pull, mirror = self.couplings @ signs, self.mirrored @ signs
            quadratic = float(signs @ (pull + 2.0 * self.field)) + self.constant
            changes = -4.0 * (signs * (pull + self.field) - single)
            others = -4.0 * signs * (mirror + self.bias)
            gains = 2.0 * len(signs) * _log_ratio(changes, quadratic) - others
            flip: int | IndexArray = int(np.argmin(gains))
            least = gains[flip]
            if least > -_LEAST:
                for group in groups:
                    s, among = signs[group], np.ix_(group, group)
                    change = -4.0 * float(s @ (pull[group] + self.field[group]))
                    change += 4.0 * float(s @ self.couplings[among] @ s)
                    other = -4.0 * float(s @ (mirror[group] + self.bias[group]))
                    other += 4.0 * float(s @ self.mirrored[among] @ s)
                    gain = 2.0 * len(signs) * _log_ratio(np.array(change), quadratic) - other
                    if gain < min(least, -_LEAST):
                        least, flip = gain, group
            if least > -_LEAST:
                return signs
            signs[flip] *= -1.0

    def _merged(self) -> tuple[FloatArray, list[IndexArray]]:
        """Return signs by merging groups, the most coupled first, and all groups of two or more."""
        count = len(self.field)
        scale = 2.0 * count / (self.constant + float(np.trace(self.couplings)))
        between = scale * self.couplings - self.mirrored
        np.fill_diagonal(between, 0.0)
        signs, sizes = np.ones(count), np.ones(count)
        members, groups = [np.array([i]) for i in range(count)], []
        for _ in range(count - 1):
            strength = np.abs(between) / np.sqrt(sizes[:, None] * sizes)
            a, b = np.unravel_index(int(np.argmax(strength)), strength.shape)
            if a == b:  # nothing is coupled
                break
            if between[a, b] > 0.0:
                signs[members[b]] *= -1.0
                between[b], between[:, b] = -between[b], -between[:, b]
            groups += [part for part in (members[a], members[b]) if len(part) > 1]
            members[a] = np.concatenate([members[a], members[b]])
            between[a] += between[b]
            between[:, a] += between[:, b]
            between[b], between[:, b], between[a, a] = 0.0, 0.0, 0.0
            sizes[a] += sizes[b]
        return signs, groups


def _log_ratio(changes: FloatArray, quadratic: float) -> FloatArray:
    return np.log(np.maximum(quadratic + changes, 1e-12 * quadratic) / quadratic)
