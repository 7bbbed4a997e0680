"""Cost of touch in a user's Drake Diagram: the sensor's share, and whole explorations.

    python benchmarks/bench_drake.py box mallet --hands wsg50 allegro
    python benchmarks/bench_drake.py --sensor        # the sensor's cost alone

Objects of 12 cm are free on a table: 0.4 kg, time step 2 ms, hydroelastic contact, a hand on a
wrist of `HandInPlant.add_wrist`, no drawing. The real-time rate is simulated time by CPU time. The
sensor's cost is that of a plant with table, object and wrist, the hand at rest, with and without
the sensor, in turns; the sensor samples at each step.
"""

import time

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp import shapes, surface_error
from lis_grasp.drake import HapticExplorer, SurfaceEstimator, TouchSensor, add_hand, add_object
from lis_grasp.exploration import STEP_FRACTION, Workspace
from lis_grasp.io.json_lines import Row
from lis_grasp.simulation.drake.object_plant import add_table
from lis_grasp_studies.harness.program import read_options
from lis_grasp_studies.harness.tables import grouped_table, mean_cell

_SIZE, _MASS, _TURNS, _LONGEST = 0.12, 0.4, 7, 600.0


class Bench:
    def __init__(self, name: str, hand_name: str, *, touches: int, feels: bool = True) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=0.002,
            contact_model="hydroelastic_with_fallback",
            discrete_contact_approximation="lagged",
        )
        plant, _ = AddMultibodyPlant(config, builder)
        self.mesh = shapes.build(name, size=_SIZE).mesh
        self.mesh.apply_translation([0.0, 0.0, -self.mesh.bounds[0, 2]])
        hand = add_hand(plant, hand_name)
        self.body = add_object(plant, self.mesh, mass=_MASS)
        add_table(plant, 0.0, under=self.mesh)
        plant.Finalize()
        home = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.45])
        plant.SetDefaultFloatingBaseBodyPose(hand.base, home)
        size = float(self.mesh.extents.max())
        space = Workspace(STEP_FRACTION * size, self.mesh.bounds.mean(axis=0), size, 0.0)
        wrist = hand.add_wrist(builder)
        explorer = HapticExplorer(hand, space, home=home, touches=touches)
        connect = builder.Connect
        connect(wrist.get_output_port(), plant.get_applied_spatial_force_input_port())
        self.plant, self.explorer = plant, explorer
        if feels:
            self.sensor = TouchSensor(plant, hand, feels=[self.body], space=space)
            self.estimator = SurfaceEstimator("blend", table=0.0)
            builder.AddSystem(self.sensor)
            for port in ("contact_results", "body_poses"):
                connect(plant.GetOutputPort(port), self.sensor.GetInputPort(port))
        joints = plant.get_desired_state_input_port(hand.instance)
        if feels and touches > 1:
            for system in (self.estimator, explorer):
                builder.AddSystem(system)
                connect(self.sensor.contacts, system.GetInputPort("contacts"))
            connect(self.estimator.estimate, explorer.GetInputPort("estimate"))
            connect(explorer.GetOutputPort("listening"), self.sensor.GetInputPort("enable"))
            connect(explorer.X_WG, wrist.GetInputPort("X_WG"))
            connect(explorer.GetOutputPort("joint_state"), joints)
        self.simulator = Simulator(builder.Build())
        root = self.simulator.get_mutable_context()
        if not feels or touches == 1:  # the hand rests
            wrist.GetInputPort("X_WG").FixValue(wrist.GetMyContextFromRoot(root), home)
            state = np.zeros(2 * len(hand.joints))
            joints.FixValue(plant.GetMyContextFromRoot(root), state)

    def explored(self) -> Row:
        self.simulator.set_monitor(self.explorer.ended)
        wall, cpu = time.perf_counter(), time.process_time()
        self.simulator.AdvanceTo(_LONGEST)
        root = self.simulator.get_context()
        exploration = self.explorer.exploration.Eval(self.explorer.GetMyContextFromRoot(root))
        estimate = self.estimator.estimate.Eval(self.estimator.GetMyContextFromRoot(root))
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        pose = self.body.EvalPoseInWorld(self.plant.GetMyContextFromRoot(root))
        corners = trimesh.transform_points(self.mesh.vertices, pose.GetAsMatrix4())
        return {
            "contacts": len(exploration.contacts),
            "probes": len(exploration.outcomes),
            "simulated": root.get_time(),
            "wall": wall,
            "cpu": cpu,
            "rate": root.get_time() / cpu,
            "moved": float(np.linalg.norm(corners - self.mesh.vertices, axis=1).max()),
            "rmsd": surface_error(estimate.mesh, self.mesh).rmsd,
        }


def sensor_cost(name: str, hand: str) -> Row:
    """Return CPU time by simulated second without and with the sensor: medians of turns."""
    benches = [Bench(name, hand, touches=1, feels=feels) for feels in (False, True)]
    seconds = np.empty((_TURNS, 2))
    for bench in benches:
        bench.simulator.AdvanceTo(0.5)  # until the object rests
    for turn in range(_TURNS):
        for k, bench in enumerate(benches):
            cpu = time.process_time()
            bench.simulator.AdvanceTo(bench.simulator.get_context().get_time() + 1.0)
            seconds[turn, k] = time.process_time() - cpu
    without, with_sensor = np.median(seconds, axis=0)
    ratio = float(np.median(seconds[:, 1] / seconds[:, 0]))
    return {"without": without, "with": with_sensor, "ratio": ratio}


def main() -> None:
    options = read_options(__doc__, objects=["box"], hands=["wsg50"], touches=15, sensor=False)
    pairs = [(name, hand) for name in options.objects for hand in options.hands]
    if options.sensor:
        groups = {f"{name} by {hand}": [sensor_cost(name, hand)] for name, hand in pairs}
        columns = [
            (f"CPU s by simulated s, {key} sensor", mean_cell(key, digits=3))
            for key in ("without", "with")
        ]
        columns += [("ratio", mean_cell("ratio", digits=2))]
    else:
        groups = {
            f"{name} by {hand}": [Bench(name, hand, touches=options.touches).explored()]
            for name, hand in pairs
        }
        columns = [(key, mean_cell(key, digits=0)) for key in ("contacts", "probes")]
        columns += [
            (f"{key} [s]", mean_cell(key, digits=1)) for key in ("simulated", "wall", "cpu")
        ]
        columns += [("real-time rate", mean_cell("rate", digits=1))]
        columns += [(f"{key} [mm]", mean_cell(key, 1e3, 3)) for key in ("moved", "rmsd")]
    print(grouped_table("drake", "Touch in a Drake Diagram", "task", groups, columns).text())


if __name__ == "__main__":
    main()
