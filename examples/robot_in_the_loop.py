"""Explore with a robot in the loop: it asks a service for touches, and a process stands for it.

    python examples/robot_in_the_loop.py --output results/robot_in_the_loop

The program of your robot takes the place of robots/feel_box.py, in any language: it writes and
reads lines of JSON.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

ROBOT = Path(__file__).parent / "robots" / "feel_box.py"
# A hand knows that there is a box of at most 12 cm about the origin, held in the air.
SERVICE = ["next", "--serve", "--hand", "allegro", "--center", "0", "0", "0", "--size", "0.12"]
COMMAND = [sys.executable, "-m", "lis_grasp.cli.main", *SERVICE, "--support", "none"]
PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}


def ask(process, **request):
    print(json.dumps(request), file=process.stdin, flush=True)
    answer = json.loads(process.stdout.readline())
    if not answer.get("ok", True):
        raise SystemExit(answer["error"])
    return answer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/robot_in_the_loop"))
    output = parser.parse_args().output
    with (
        subprocess.Popen([*COMMAND, "--output", output], **PIPES) as service,
        subprocess.Popen([sys.executable, ROBOT], **PIPES) as robot,
    ):
        touch = ask(service, request="next")
        while touch["contacts"] < 20:
            measured = ask(
                robot, **touch
            )  # a robot moves its hand to X_OH, and then from start to end
            if measured["points"]:
                report = {"points": measured["points"], "normals": measured["normals"]}
            else:
                report = {"status": "missed"}
            touch = ask(service, request="next", free_points=measured["free"], **report)
        surface = ask(service, request="estimate")
        grasps = ask(service, request="grasp", grasps=3)["grasps"]
    print(f"{touch['contacts']} contacts; extents {surface['extents']} m; {len(grasps)} grasps")
    print(f"wrote contacts.ply, surface.ply and grasps.json in {output}")


if __name__ == "__main__":
    main()
