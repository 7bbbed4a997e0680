"""Examples of the command line, shown at the end of each verb's help."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

EXAMPLES: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "run": (
            ("box --output results/demo", "a built-in shape, no prior knowledge"),
            ("part.stl --units mm --hand wsg50", "your own mesh, a parallel-jaw gripper"),
            ("mallet --known --touches 20 --seed 3", "position and size known, an ideal sensor"),
            ("box --arm iiwa14", "an arm carries the hand"),
        ),
        "explore": (
            ("mallet --until-coverage 0.95 --output out", "stop when enough is covered"),
            ("box --known --prober kinematic", "by geometry alone, in a second"),
        ),
        "next": (("contacts.csv --hand allegro", "where your robot should touch, and why"),),
        "contacts": (
            ("session.bag --list", "the topics of a log"),
            ("log.csv --output contacts.csv", "its touches as contacts"),
        ),
        "see": (
            ("depth.png --camera camera.yaml --output out", "the object above the table z = 0"),
            (
                "depth.npy --camera camera.yaml --mask mask.png",
                "the pixels of the object are known",
            ),
        ),
        "estimate": (
            ("contacts.csv --output out", "columns x,y,z,nx,ny,nz in metres"),
            ("contacts.ply --estimator gpis --position-noise 0.001", "another estimator"),
        ),
        "grasp": (
            ("out/surface.ply --hand wsg50", "an estimate"),
            ("part.stl --units mm --mass 0.5", "any mesh, of known mass"),
        ),
        "lift": (
            ("out/grasps.json", "the best grasp on the true object"),
            ("out/grasps.json --best 5 --simulator mujoco", "five grasps in MuJoCo"),
        ),
        "motion": (("out/grasps.json --arm iiwa14", "trajectories of an arm"),),
        "export": (("out/surface.ply --mass 0.3", "the estimate for other simulators"),),
        "outline": (("results/demo --clearance-for 0.9", "a cut-out that the object fits into"),),
        "view": (("results/demo", "then open the address that is printed"),),
        "hand": (
            ("new my_hand.urdf", "a first YAML of your hand"),
            ("view my_hand.yaml", "a page with its pads and postures"),
        ),
        "doctor": (
            ("", "this machine"),
            ("--hand my_hand.yaml", "a hand's file"),
            ("--hand leap", "a vendor's hand, or how to get its model"),
        ),
    }
)
"""For each verb, the arguments of some calls and their purposes."""


def format_examples(verb: str, examples: Sequence[tuple[str, str]]) -> str:
    """Return the arguments and purposes of calls of a verb as lines of text."""
    calls = [(f"lis-grasp {verb} {call}".rstrip(), purpose) for call, purpose in examples]
    width = max(len(call) for call, _ in calls)
    return "\n".join(["examples:", *(f"  {call:<{width}}  # {purpose}" for call, purpose in calls)])
