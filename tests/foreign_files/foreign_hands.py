"""Grippers as other programs describe them, each with its truth."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh
from foreign import Outcome, outcome_of

from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.draft.yaml_text import hand_yaml
from lis_grasp.robots.hand import Hand

_NAMES = (
    ("left", "right"),
    ("1", "2"),
    ("01", "010"),
    ("on", "off"),
    ("left: joint", "- right"),
    ("2024-01-01", "12:30:00"),
    ("夹爪左", "夹爪右"),
    ("finger's", 'finger"2'),
    ("l/joint", "r.joint"),
    ("~", "null"),
)
_LINKS = (("base", "l", "r"), ("0x1f", "1e3", "1_000"), ("no", "yes", "y"), ("手", "指1", "指2"))
_STROKE, _MASS, _GAP = 0.04, 1.2, 0.012


def check_hand(folder: Path, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield what becomes of a description that is drafted, written and read again."""
    names = [str(name) for name in rng.choice(np.array(_NAMES, object))]
    links = [str(name) for name in rng.choice(np.array(_LINKS, object))]
    path = _write(folder, names, links, rng)

    def read() -> Hand:
        draft = draft_hand(path, name="grip", rng=np.random.default_rng(0))
        written = folder / "grip.yaml"
        named = path.relative_to(folder).as_posix()
        written.write_text(hand_yaml(draft.hand, named, draft.edits, draft.notes), "utf-8")
        return Hand.load(written)

    def is_right(hand: Hand) -> bool:
        # Masses are written with all digits; a jaw opens by its stroke.
        return bool(
            sorted(hand.joint_names) == sorted(names)
            and hand.kind == "parallel_jaw"
            and len(hand.pads) == 2
            and np.allclose(hand.upper - hand.lower, _STROKE)
            and {pad.link for pad in hand.pads} == set(links[1:])
            and np.isclose(sum(i.mass for i in hand.inertials.values()), _MASS)
        )

    yield "bare", outcome_of(read, is_right)
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):  # refused, with this advice
        text = content.decode("utf-16").replace("utf-16", "utf-8")
        path.write_text(text, encoding="utf-8")
    yield "known", outcome_of(read, is_right)


def _write(folder: Path, names: list[str], links: list[str], rng: np.random.Generator) -> Path:
    """Write a URDF whose units, places of meshes, order and encoding are drawn at random."""
    scale = 1e3 if rng.random() < 0.5 else 1.0
    ending = str(rng.choice(["stl", "STL", "obj", "dae", "ply"]))
    meshes = folder / "lab_description" / "meshes"
    meshes.mkdir(parents=True)
    for name, size, center in (
        ("base", (0.11, 0.05, 0.06), (0.0, 0.0, 0.03)),
        ("finger", (0.012, 0.02, 0.06), (0.0, 0.0, 0.03)),
    ):
        box = trimesh.creation.box(size)
        box.apply_translation(center)
        box.apply_scale(scale)
        box.export(meshes / f"{name}.{ending}", file_type=ending.lower())
    prefix = str(rng.choice(["../meshes/", "package://lab_description/meshes/"]))
    scaled = 'scale="0.001 0.001 0.001"' if scale > 1.0 else ""
    parts = []
    for k, link in enumerate(links):
        uri = f"{prefix}{'finger' if k else 'base'}.{ending}"
        mesh = f'<geometry><mesh filename="{uri}" {scaled}/></geometry>'
        mass = 0.2 if k else 0.8
        parts.append(
            f'<link name={quoteattr(link)}><inertial><origin xyz="0 0 0.03"/><mass value="{mass}"/>'
            '<inertia ixx="0.0005" iyy="0.0006" izz="0.0007" ixy="0" ixz="0" iyz="0"/></inertial>'
            f"<visual>{mesh}</visual><collision>{mesh}</collision></link>"
        )
    for k, (joint, link) in enumerate(zip(names, links[1:], strict=True)):
        side = -1 if k else 1
        parts.append(
            f'<joint name={quoteattr(joint)} type="prismatic"><parent link={quoteattr(links[0])}/>'
            f'<child link={quoteattr(link)}/><origin xyz="{side * _GAP / 2} 0 0.06"/>'
            f'<axis xyz="{side} 0 0"/><limit lower="0" upper="{_STROKE}" effort="40"'
            ' velocity="0.2"/></joint>'
        )
    order = rng.permutation(len(parts))
    body = "\n".join(parts[k] for k in order)
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "utf-16"]))
    declared = {"utf-16": "utf-16"}.get(encoding, "utf-8")
    text = f'<?xml version="1.0" encoding="{declared}"?>\n<robot name="grip">{body}</robot>\n'
    path = folder / "lab_description" / "urdf" / "grip.urdf"
    path.parent.mkdir()
    path.write_bytes(text.encode(encoding))
    return path
