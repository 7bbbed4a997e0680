"""Touch, grasp and lift with an arm: outcomes, use of its limits, and time, on built-in shapes.

python benchmarks/bench_arm.py [--arm iiwa14] [--hand allegro] [--touches 20] [--seeds 1]
                               [--prober dynamic] [--objects box,cylinder] [--free]
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lis_grasp import shapes
from lis_grasp.cli.main import main as lis_grasp


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arm", default="iiwa14")
    parser.add_argument("--hand", default="allegro")
    parser.add_argument("--touches", default="20")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--prober", default="dynamic")
    parser.add_argument("--objects", default=",".join(shapes.NAMES), help="separated by commas")
    parser.add_argument("--free", action="store_true", help="nothing is known of the object")
    options = parser.parse_args()
    reasons: Counter[str] = Counter()
    unwanted: Counter[str] = Counter()
    seconds, efforts, speeds, forces = [], [], [], []
    for name in options.objects.split(","):
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            with TemporaryDirectory() as folder:
                arguments = ["run", name, "--arm", options.arm, "--hand", options.hand]
                arguments += ["--touches", options.touches, "--prober", options.prober]
                arguments += ["--seed", str(seed), "--output", folder]
                arguments += [] if options.free else ["--known"]
                start, cpu = time.perf_counter(), time.process_time()
                code = lis_grasp(arguments)
                wall, cpu = time.perf_counter() - start, time.process_time() - cpu
                path = Path(folder) / "report.json"
                report = json.loads(path.read_text()) if code == 0 else {}
            lift = report.get("lift", {"reason": "failed"})
            reasons[lift["reason"]] += 1
            seconds.append(wall)
            touched = report.get("arm", {}).get("touches")
            use = [u for u in (lift.get("arm"), touched) if u is not None]
            efforts += [u["effort"] for u in use]
            speeds += [u["speed"] for u in use]
            for u in use:
                unwanted.update(u["contacts"])
            if touched is not None:
                forces.append(touched["contact_force"])
            probes = report.get("exploration", {}).get("probes")
            print(
                f"{name:16} seed {seed}  {lift['reason']:14} {report.get('touches')} touches of"
                f" {probes} probes  slip {1e3 * lift.get('slip', 0.0):4.1f} mm"
                f"  {wall:5.1f} s, {cpu:5.1f} s of one core",
                flush=True,
            )
    held = reasons["held"]
    print(f"{options.arm}, {options.hand}: {held} of {reasons.total()} held; {dict(reasons)}")
    print(f"a run: median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s")
    if efforts:
        print(f"largest use of a limit: effort {max(efforts):.2f}, speed {max(speeds):.2f}")
    if forces:
        print(f"largest force of a touch: median {np.median(forces):.2f} N, {max(forces):.2f} N")
    print(f"unwanted contacts, in steps: {dict(unwanted)}")


if __name__ == "__main__":
    main()
