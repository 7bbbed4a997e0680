"""Touch in a Drake Diagram of your own: wrist, sensor, estimator and explorer are systems in it.

python examples/own_diagram.py --output results/own_diagram
"""

import argparse
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from lis_grasp.drake import HapticExplorer, SurfaceEstimator, TouchSensor, add_hand, add_object
from lis_grasp.exploration import Workspace


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/own_diagram"))
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    hand, body = add_hand(plant, "wsg50"), add_object(plant, "mallet")
    plant.WeldFrames(plant.world_frame(), body.body_frame())
    plant.Finalize()
    home = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.5])
    plant.SetDefaultFloatingBaseBodyPose(hand.base, home)
    space = Workspace(step=0.05, center=np.zeros(3), size=0.2)  # all that is known of the object
    wrist = hand.add_wrist(builder)
    sensor = builder.AddSystem(TouchSensor(plant, hand, feels=[body], space=space))
    estimator = builder.AddSystem(SurfaceEstimator("blend"))
    explorer = builder.AddSystem(HapticExplorer(hand, space, home=home, touches=12))
    for port in ("contact_results", "body_poses"):
        builder.Connect(plant.GetOutputPort(port), sensor.GetInputPort(port))
    builder.Connect(sensor.contacts, estimator.GetInputPort("contacts"))
    builder.Connect(sensor.contacts, explorer.GetInputPort("contacts"))
    builder.Connect(estimator.estimate, explorer.GetInputPort("estimate"))
    builder.Connect(explorer.GetOutputPort("listening"), sensor.GetInputPort("enable"))
    builder.Connect(explorer.X_WG, wrist.GetInputPort("X_WG"))
    builder.Connect(wrist.get_output_port(), plant.get_applied_spatial_force_input_port())
    joints = plant.get_desired_state_input_port(hand.instance)
    builder.Connect(explorer.GetOutputPort("joint_state"), joints)
    simulator = Simulator(builder.Build())
    simulator.set_monitor(explorer.ended)
    simulator.AdvanceTo(300.0)
    context = estimator.GetMyContextFromRoot(simulator.get_context())
    estimate = estimator.estimate.Eval(context)
    estimate.contacts.save(output / "contacts.ply")
    estimate.mesh.export(output / "surface.ply")
    print(f"{len(estimate.contacts)} contacts in {context.get_time():.0f} s of simulated time")
    print(f"wrote {output / 'contacts.ply'} and {output / 'surface.ply'}")


if __name__ == "__main__":
    main()
