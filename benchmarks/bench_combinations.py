"""Every hand on every arm, with both probers and two simulators: what runs, and what says why not.

    python benchmarks/bench_combinations.py  # 64 runs: the package's hands and arms
    python benchmarks/bench_combinations.py leap shadow --arms none iiwa14 franka_panda

Prints how each run of box and cylinder ended: the lift's reason, or the sentence that refused it.
"""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import lis_grasp as lg
from lis_grasp.exceptions import LisGraspError
from lis_grasp.robots.shipped_models import ARM_NAMES, HAND_NAMES
from lis_grasp_studies.harness.program import exit_code, read_options

_PARTS = (("dynamic", "kinematic"), ("drake", "mujoco"), ("box", "cylinder"))


def ended(hand: str, arm: str, prober: str, simulator: str, name: str, touches: int) -> str:
    """Return the reason of the lift, or the sentence that refused the run."""
    chosen = {"hand": hand, "prober": prober, "simulator": simulator, "touches": touches}
    with TemporaryDirectory() as folder:
        try:
            run = lg.run(name, folder=Path(folder), arm=None if arm == "none" else arm, **chosen)
        except LisGraspError as error:
            begun = (Path(folder) / "touches.jsonl").exists()
            return f"{'failed' if begun else 'refused'}: {error}"
    lift = (run.report or {}).get("lift")
    return "no_grasp" if lift is None else str(lift["reason"])


def main() -> int:
    options = read_options(__doc__, objects=list(HAND_NAMES), arms=["none", *ARM_NAMES], touches=20)

    def run_all() -> None:
        for hand, arm, *parts in product(options.objects, options.arms, *_PARTS):
            words = ended(hand, arm, *parts, options.touches)
            print(f"{hand}, {arm}, {', '.join(parts)}: {words}", flush=True)

    return exit_code("bench_combinations", run_all)


if __name__ == "__main__":
    sys.exit(main())
