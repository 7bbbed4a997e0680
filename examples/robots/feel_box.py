"""Stand-in for a robot: a fingertip of radius 0 that feels a box of 12 cm.

It reads a motion a line, as JSON, and answers with a line: the points that it touched with their
outward normals, and points in free space; all in metres in the object's frame.
"""

import json
import sys

import numpy as np

from lis_grasp import shapes

box = shapes.build("box", 0.12).mesh
for line in sys.stdin:
    motion = json.loads(line)  # a robot moves its palm to X_OH, its joints to joint_positions
    start, end = np.array(motion["start"]), np.array(motion["end"])
    points, _, faces = box.ray.intersects_location([start], [end - start], multiple_hits=False)
    reached = np.linalg.norm(points - start, axis=1) <= np.linalg.norm(end - start)
    points, normals = points[reached], box.face_normals[faces[reached]]
    free = [start, 0.5 * (start + (points[0] if len(points) else end))]
    answer = {"points": points, "normals": normals, "free": np.array(free)}
    print(json.dumps({name: value.tolist() for name, value in answer.items()}), flush=True)
