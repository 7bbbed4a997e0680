"""Links of a whole robot where its hands begin: forks at the ends of arms."""

from __future__ import annotations

from lis_grasp.robots.draft.find_fingers import leaf_groups, rigid_groups
from lis_grasp.robots.hand_parts import joints_to
from lis_grasp.robots.link_tree import HandModel

_ARM = 3  # movable joints before a hand, at least
_FINGER = 7  # movable joints of a finger, at most


def find_hand_bases(model: HandModel) -> tuple[str, ...]:
    """Return the links where the hands of a whole robot begin; none for a hand alone.

    Each is the first link of a leaf's chain that carries several leaves, has three movable joints
    or more before it, and no more than seven after it.
    """
    groups = rigid_groups(model)
    chains = [
        [groups[j.parent] for j in joints_to(model.joints, leaf) if j.kind != "fixed"] + [leaf]
        for leaf in leaf_groups(model)
    ]
    bases = []
    for chain in chains:
        for before, group in enumerate(chain[:-1]):
            after = [c[c.index(group) + 1 :] for c in chains if group in c]
            forks = len({rest[0] for rest in after}) > 1
            if before >= _ARM and forks and max(map(len, after)) <= _FINGER:
                bases.append(group)
                break
    return tuple(dict.fromkeys(bases))
