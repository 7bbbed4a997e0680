"""Files as other programs write them are read right, or refused with the option that settles it.

`ROBUSTNESS` multiplies their number, and `ROBUSTNESS_SEED` draws others.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from foreign import Outcome
from foreign_contacts import check_contacts
from foreign_hands import check_hand
from foreign_logs import check_log
from foreign_meshes import check_mesh

_TIMES = int(os.environ.get("ROBUSTNESS", "1"))
_SEED = int(os.environ.get("ROBUSTNESS_SEED", "0"))
_Check = Callable[[Path, np.random.Generator], Iterator[tuple[str, Outcome]]]
# Files of each kind in CI.
_KINDS: dict[str, tuple[_Check, int]] = {
    "logs": (check_log, 10),
    "contacts": (check_contacts, 10),
    "meshes": (check_mesh, 10),
    "hands": (check_hand, 5),
}


@pytest.mark.by_default("meshes", "contacts")
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=pytest.mark.slow if k == "hands" else ()) for k in _KINDS]
)
def test_files_of_other_programs_are_right_or_refused(kind: str, tmp_path: Path) -> None:
    check, number = _KINDS[kind]
    counts: Counter[tuple[str, Outcome]] = Counter()
    for case in range(number * _TIMES):
        folder = tmp_path / str(case)
        folder.mkdir()
        for situation, outcome in check(folder, np.random.default_rng((_SEED, case))):
            counts[situation, outcome] += 1
            if situation == "answered wrongly":
                continue
            # A file alone may leave a question open, but no wrong result is silent.
            assert outcome in ("right", "refused"), (case, situation)
            # With what its user knows it is right, unless a unit in it is mistaken.
            assert (situation, outcome) != ("known", "refused"), case
            assert (situation, outcome) != ("mistaken", "right"), case
    print(kind, dict(counts))
    assert counts["known", "right"] > 0
    answers = {outcome: counts["answered wrongly", outcome] for outcome in ("noted", "wrong")}
    assert answers["wrong"] <= 0.1 * answers["noted"]
