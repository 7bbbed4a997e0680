"""Convex decomposition of an object for MuJoCo, which collides convex bodies only (CoACD)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh

from lis_grasp.exceptions import needed_package, require_packages

# Concavity of a piece, by its size, in the metric of Wei et al.: on a torus of 12 cm, 98 % of the
# surface is within 0.5 mm of the pieces.
_CONCAVITY = 0.02
# A hull with this much more volume is the object itself, but for rounding.
_CONVEX = 1e-3
# Effort of the search for cuts: more gives fewer pieces, not better ones.
_SEARCH = {"mcts_iterations": 60, "mcts_nodes": 10, "mcts_max_depth": 2, "resolution": 1000}


def convex_pieces(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, ...]:
    """Return convex meshes whose union approximates a watertight mesh [m].

    Collision-aware concavity and tree search (Wei, Liu, Ling and Su, 2022): the object is cut along
    planes, so that its pieces' hulls never recede from its surface; they protrude where it is
    concave. A convex object is one piece: its hull. The same mesh gives the same pieces; those of
    the last few objects are kept, because cutting takes seconds.

    Raises `InvalidOptionError` if the package coacd is not installed.
    """
    if _is_convex(mesh):
        return (mesh.convex_hull,)
    return _cut(mesh.vertices.tobytes(), mesh.faces.tobytes())


@lru_cache(maxsize=8)
def _cut(vertices: bytes, faces: bytes) -> tuple[trimesh.Trimesh, ...]:
    """Return the pieces of a mesh, by the bytes of its vertices (V, 3) and faces (F, 3)."""
    with needed_package("coacd", "mujoco", option="the simulator mujoco"):
        import coacd
    coacd.set_log_level("off")
    found = coacd.run_coacd(
        coacd.Mesh(
            np.frombuffer(vertices).reshape(-1, 3),
            np.frombuffer(faces, dtype=np.int64).reshape(-1, 3),
        ),
        threshold=_CONCAVITY,
        preprocess_mode="off",  # the mesh is watertight
        **_SEARCH,
        seed=0,
    )
    pieces = [trimesh.convex.convex_hull(np.asarray(vertices)) for vertices, _ in found]
    return tuple(piece for piece in pieces if piece.volume > 0.0)


def require_mujoco(mesh: trimesh.Trimesh) -> None:
    """Raise `InvalidOptionError` if a package is missing that simulations of an object need."""
    names = ("mujoco",) if _is_convex(mesh) else ("mujoco", "coacd")
    require_packages(*names, extra="mujoco", option="the simulator mujoco")


def _is_convex(mesh: trimesh.Trimesh) -> bool:
    return bool(mesh.convex_hull.volume <= (1.0 + _CONVEX) * mesh.volume)
