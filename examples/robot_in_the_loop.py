"""Explore with a robot in the loop: a process that answers over a pipe stands for it.

    python examples/robot_in_the_loop.py --output results/robot_in_the_loop

The program of your robot takes the place of robots/feel_box.py.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from lis_grasp import BlendedImplicitSurface, Contacts, Hand, extract_mesh
from lis_grasp.exploration import ExplorationSetup, ProbeOutcome, TargetPolicy, Workspace, explore
from lis_grasp.probing.approach_planner import ApproachPlanner

ROBOT = Path(__file__).parent / "robots" / "feel_box.py"


class PipeProber:
    def __init__(self, hand, robot):
        self.planner, self.robot = ApproachPlanner(hand), robot

    def probe(self, probe, obstacles=None):
        approach = self.planner.plan(probe, obstacles)
        if approach is None:
            return ProbeOutcome(probe, "blocked", reason="no approach is free of collision")
        motion = {"X_OH": approach.X_OH, "q": approach.posture.joint_positions}
        motion |= {"start": probe.start, "end": probe.end}
        line = json.dumps({name: value.tolist() for name, value in motion.items()})
        print(line, file=self.robot.stdin, flush=True)
        answer = json.loads(self.robot.stdout.readline())
        contacts = Contacts(answer["points"], answer["normals"])
        status = "touched" if len(contacts) else "missed"
        return ProbeOutcome(probe, status, contacts, free_points=answer["free"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/robot_in_the_loop"))
    output = parser.parse_args().output
    space = Workspace(step=0.03, center=np.zeros(3), size=0.12)  # where the object is [m]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, ROBOT], **pipes) as robot:
        prober = PipeProber(Hand.load("allegro"), robot)
        estimate, rng = BlendedImplicitSurface.from_contacts, np.random.default_rng(0)
        setup = ExplorationSetup(TargetPolicy(space), estimate, touches=20, space=space)
        exploration = explore(prober, setup, rng=rng)
    exploration.contacts.save(output / "contacts.ply")
    extract_mesh(estimate(exploration.contacts)).export(output / "surface.ply")
    print(exploration.summary())
    print(f"wrote contacts.ply and surface.ply in {output}")


if __name__ == "__main__":
    main()
