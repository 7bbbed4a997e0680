"""Text of a hand's YAML file, with a comment on every key."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.io.yaml_files import word
from lis_grasp.robots._description import DescriptionEdits
from lis_grasp.robots.hand import Hand, thumb_of
from lis_grasp.robots.hand_check import exclusion_lines
from lis_grasp.typing import FloatArray


def hand_yaml(hand: Hand, urdf: str, edits: DescriptionEdits, notes: Sequence[str] = ()) -> str:
    """Return the YAML file of a hand, whose description is `urdf`, changed by `edits`."""
    return "\n".join(_lines(hand, urdf, edits, notes)) + "\n"


def _lines(hand: Hand, urdf: str, edits: DescriptionEdits, notes: Sequence[str]) -> Iterator[str]:
    yield "# Drafted by `lis-grasp hand new`. Lengths in m, angles in rad, forces in N."
    yield from (f"# Note: {note}." for note in notes)
    yield f"name: {word(hand.name)}"
    yield f"kind: {hand.kind}  # multi_finger: rounded pads; parallel_jaw: two flat parallel pads"
    yield f"urdf: {word(urdf)}"
    xacro_args = [f"{word(k)}: {word(v)}" for k, v in edits.xacro_args.items()]
    locked = [f"{word(k)}: {v:.6g}" for k, v in edits.locked_joints.items()]
    base, parts = word(edits.base_link or ""), ", ".join(map(word, edits.convex_parts))
    efforts = (
        "effort_limits:  # instead of the file's [N m or N]; usual values: check them",
        *(f"  {word(name)}: {v:g}" for name, v in edits.effort_limits.items()),
    )
    optional = {  # what is there if the description is changed so
        f"xacro_args: {{{', '.join(xacro_args)}}}": xacro_args,
        f"base_link: {base}  # links before it are left out": edits.base_link,
        f"locked_joints: {{{', '.join(locked)}}}  # do not move": locked,
        "\n".join(efforts): edits.effort_limits,
        "repair: true  # impossible inertias and missing masses are replaced": edits.repair,
        f"convex_parts: [{parts}]  # concave links: several bodies, not one hull": parts,
    }
    yield from (line for line, is_there in optional.items() if is_there)
    yield "# Movable joints in the file's order; a posture has one number for each."
    yield f"joints: [{', '.join(map(word, hand.joint_names))}]"
    yield "# Palm frame H in the base link: z is the approach, x is from the thumb to the fingers."
    rpy = Rotation.from_matrix(hand.X_LH[:3, :3]).as_euler("xyz")
    yield f"palm_frame: {{translation: {_row(hand.X_LH[:3, 3])}, rpy: {_row(rpy)}}}"
    yield f"approach: {_row(hand.approach_H)}  # in H: the hand's motion towards an object"
    yield f"max_contact_force: {hand.max_contact_force:g}  # of one finger, by the efforts"
    yield "# Centre and axis in the link's frame; radius 0: a flat face."
    yield "pads:"
    for pad in hand.pads:
        yield (
            f"  {word(pad.finger)}: {{link: {word(pad.link)}, center: {_row(pad.center_L)},"
            f" radius: {pad.radius:.4g}, axis: {_row(pad.axis_L)},"
            f" half_angle: {pad.half_angle:.2f}}}"
        )
    yield "pregrasps:"
    for name, q in hand.pregrasps.items():
        yield f"  # gap about {_gap(hand, q):.3f}"
        yield f"  {name}: {_row(q)}"
    if hand.probe_postures:
        yield "probe_postures:"
    for finger, posture in hand.probe_postures.items():
        yield f"  {word(finger)}:"
        yield f"    positions: {_row(posture.joint_positions)}"
        yield f"    direction: {_row(posture.direction_H)}"
        yield (
            f"    tip: {{link: {word(posture.link)}, center: {_row(posture.center_L)},"
            f" radius: {posture.radius:.4g}}}"
        )
    yield "# Pairs of links that collide by design; those joined by a joint are excluded already."
    pairs = sorted(hand.self_collision_exclusions - hand.joined_links)
    yield f"self_collision_exclusions:{'' if pairs else ' []'}"
    yield from exclusion_lines(pairs)


def _gap(hand: Hand, q: FloatArray) -> float:
    """Return the distance from the thumb's pad surface to the middle of the others' [m]."""
    centers, axes = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)
    radii = np.array([pad.radius for pad in hand.pads])[:, None]
    faces = centers + radii * axes
    thumb = thumb_of(axes)
    return float(np.linalg.norm(np.delete(faces, thumb, axis=0).mean(axis=0) - faces[thumb]))


def _row(values: FloatArray) -> str:
    # Adding 0 turns -0 into 0.
    return "[" + ", ".join(f"{round(float(v), 4) + 0.0:g}" for v in values) + "]"
