"""Plan grasps of one object with FRoGGeR; run by bench_frogger.py in FRoGGeR's own interpreter.

    python frogger_worker.py FROGGER_FOLDER JOB.json RESULT.json

The job names a mesh, seeds, friction, the time limit of a grasp, and modes: "free" (FRoGGeR's
example with the floating Allegro hand), "table" (the same hand above a table, as in its example
with an arm), either of them also "fixed" (see `model_class`). Nothing of lis_grasp is imported.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

_NAME = "benchmark_object"
# The settings of FRoGGeR's examples/algr.py.
_MODEL = {"ns": 4, "d_min": 0.001, "d_pen": 0.005, "l_bar_cutoff": 0.3, "hand": "rh", "viz": False}
_SOLVER = {
    "tol_surf": 1e-3,
    "tol_joint": 1e-2,
    "tol_col": 1e-3,
    "tol_fclosure": 1e-5,
    "xtol_rel": 1e-6,
    "xtol_abs": 1e-6,
    "maxeval": 1000,
}
# Centres of the spherical tips in the last links of its Allegro model [m], and those links.
_TIPS = {"if": 0.0267, "mf": 0.0267, "rf": 0.0267, "th": 0.0423}


class OutOfTimeError(Exception):
    """A grasp took longer than its time limit."""


def main() -> int:
    folder, job_file, result_file = map(Path, sys.argv[1:4])
    sys.path.insert(0, str(folder))
    try:
        import frogger.robots.robots
        import frogger.solvers  # noqa: F401
    except ImportError as error:
        print(f"FRoGGeR cannot be imported from {folder}: {error}", file=sys.stderr)
        return 1
    job = json.loads(job_file.read_text())
    result_file.write_text(json.dumps(plan_all(job)))
    return 0


def plan_all(job: dict) -> dict:
    import frogger.objects
    import numpy as np
    import trimesh
    from pydrake.math import RigidTransform

    mesh = trimesh.load(job["mesh"])
    X_WO = RigidTransform(np.array([0.0, 0.0, -mesh.bounds[0, 2]]))
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        frogger.objects.ROOT = folder  # where it looks for the pieces of an object
        pieces = write_pieces(mesh, Path(folder) / "data" / _NAME / "collisions")
        target = frogger.objects.MeshObjectConfig(
            X_WO=X_WO, mesh=mesh, name=_NAME, enforce_watertight=True, clean=False
        ).create()
        prepared = time.process_time() - start
        plans = {mode: plan(job, target, mode) for mode in job["modes"]}
    return {"preparation": prepared, "pieces": pieces, "plans": plans}


def write_pieces(mesh, folder: Path) -> int:
    """Write an object's convex pieces, prepared as those of FRoGGeR's own data.

    Those are V-HACD's, 16 at the most with 64 vertices at the most; a convex object is one piece,
    and exact.
    """
    if mesh.is_convex:
        pieces = [mesh]
    else:
        pieces = mesh.convex_decomposition(
            maxConvexHulls=16, maxNumVerticesPerCH=64, resolution=400_000
        )
    folder.mkdir(parents=True)
    for i, piece in enumerate(pieces):
        piece.convex_hull.export(folder / f"{_NAME}_col_{i}.obj")
    return len(pieces)


def plan(job: dict, target, mode: str) -> list[dict]:
    import numpy as np
    from frogger.robots.robots import AlgrModelConfig
    from frogger.sampling import HeuristicAlgrICSampler
    from frogger.solvers import FroggerConfig

    table, fixed = mode.startswith("table"), mode.endswith("fixed")
    config = AlgrModelConfig(obj=target, mu=job["friction"], **_MODEL)
    config.model_class = model_class(table=table, fixed=fixed)
    model = config.create()
    sampler = HeuristicAlgrICSampler(model, table=table)
    # Every start of its optimisation draws palm poses until one is reached.
    start_from, draw_palm = sampler.sample_configuration, sampler.sample_palm_pose
    clock = {"deadline": 0.0, "starts": 0}

    def counted_start():
        clock["starts"] += 1
        return start_from()

    def palm_in_time():
        if time.process_time() > clock["deadline"]:
            raise OutOfTimeError
        return draw_palm()

    sampler.sample_configuration, sampler.sample_palm_pose = counted_start, palm_in_time
    solver = FroggerConfig(model=model, sampler=sampler, **_SOLVER).create()
    grasps = []
    start = model.plant.GetPositions(model.plant_context)
    for seed in [2**31, *job["seeds"]]:  # the first one is a warm-up: it may still compile
        # It starts from its last posture: one that diverged would spoil all later attempts.
        model.plant.SetPositions(model.plant_context, start)
        np.random.seed(seed)  # noqa: NPY002, FRoGGeR draws from the global state
        cpu, wall = time.process_time(), time.perf_counter()
        clock |= {"deadline": cpu + job["time_limit"], "starts": 0}
        try:
            q = solver.generate_grasp()
        except OutOfTimeError:
            q = None
        used = time.process_time() - cpu
        grasp = {"seed": seed, "cpu": used, "wall": time.perf_counter() - wall}
        grasp |= {"starts": clock["starts"], "found": q is not None and used <= job["time_limit"]}
        if grasp["found"]:
            grasp |= describe(model, q)
        grasps.append(grasp)
    return grasps[1:]


def describe(model, q) -> dict:
    """Return a planned posture and its contacts, in the object's frame O.

    ``touches`` are the points of the fingertips nearest to the object's pieces;
    ``planned_contacts`` are FRoGGeR's own contacts.
    """
    import numpy as np

    model.compute_all(q)
    plant, context = model.plant, model.plant_context
    X_OW = model.obj.X_WO.inverse()

    def pose(link: str):
        return X_OW @ plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(f"algr_rh_{link}"))

    tips = [pose(f"{finger}_ds") @ np.array([0.0, 0.0, z]) for finger, z in _TIPS.items()]
    inspector = model.query_object.inspector()
    query = BodyFrameQuery(model._qo_port.Eval(model.sg_context))
    nearest: dict = {}  # finger -> (distance, point)
    for pair in model.hand_obj_pairs:
        found = query.ComputeSignedDistancePairClosestPoints(*pair)
        for geometry, point in ((found.id_A, found.p_ACa), (found.id_B, found.p_BCb)):
            name = inspector.GetName(geometry)
            finger = next((finger for finger in _TIPS if f"_{finger}_ds_tip" in name), None)
            if finger and found.distance < nearest.get(finger, (np.inf,))[0]:
                nearest[finger] = (found.distance, pose(f"{finger}_ds") @ point)
    return {
        "X_OP": pose("palm").GetAsMatrix4().tolist(),
        "joint_positions": np.asarray(q)[-16:].tolist(),
        "tips": np.array(tips).tolist(),
        "touches": [nearest[finger][1].tolist() for finger in _TIPS],
        "gaps": [nearest[finger][0] for finger in _TIPS],
        "planned_contacts": model.P_OF.T.tolist(),
    }


def model_class(*, table: bool, fixed: bool) -> type:
    """Return FRoGGeR's floating Allegro hand, above a table at z = 0 if asked for.

    Its model of an arm has such a table and the pairs not to check; only the box is added.
    Fixed: Drake returns the nearest points of two geometries in the frames of the geometries.
    FRoGGeR treats them as points in the frames of the bodies, which for the fingertips are 27 or
    42 mm away. The fixed model transforms them to the frames of the bodies.
    """
    import numpy as np
    from frogger.robots.robots import AlgrModel, FR3AlgrModel
    from pydrake.geometry import Box
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import CoulombFriction

    class Allegro(FR3AlgrModel if table else AlgrModel):
        @property
        def query_object(self):
            query = super().query_object
            return BodyFrameQuery(query) if fixed else query

        def _plant_additions(self) -> None:
            if table:
                self.plant.RegisterCollisionGeometry(
                    self.plant.world_body(),
                    RigidTransform(np.array([0.0, 0.0, -0.5])),
                    Box(2.0, 2.0, 1.0),
                    "tabletop_collision",
                    CoulombFriction(0.7, 0.7),
                )

    return Allegro


class BodyFrameQuery:
    """Drake's distance queries, with the nearest points in the frames of the bodies."""

    def __init__(self, query) -> None:
        self._query = query

    def inspector(self):
        return self._query.inspector()

    def ComputeSignedDistancePairwiseClosestPoints(self, max_distance: float) -> list:
        found = self._query.ComputeSignedDistancePairwiseClosestPoints(max_distance=max_distance)
        return [self._in_body_frames(pair) for pair in found]

    def ComputeSignedDistancePairClosestPoints(self, a, b):
        return self._in_body_frames(self._query.ComputeSignedDistancePairClosestPoints(a, b))

    def _in_body_frames(self, pair) -> SimpleNamespace:
        inspector = self._query.inspector()
        return SimpleNamespace(
            id_A=pair.id_A,
            id_B=pair.id_B,
            distance=pair.distance,
            nhat_BA_W=pair.nhat_BA_W,
            p_ACa=inspector.GetPoseInFrame(pair.id_A) @ pair.p_ACa,
            p_BCb=inspector.GetPoseInFrame(pair.id_B) @ pair.p_BCb,
        )


if __name__ == "__main__":
    sys.exit(main())
