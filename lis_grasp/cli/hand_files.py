"""`lis-grasp hand`: write the first YAML of a hand, and draw a hand with its pads and postures."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

from lis_grasp.cli import options as opt
from lis_grasp.cli.progress import next_step, say, say_findings
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.robots.draft.pipeline import draft_hand
from lis_grasp.robots.draft.yaml_text import hand_yaml
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_check import hand_findings
from lis_grasp.robots.model_uri import resolve_uri


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's two actions to its parser."""
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    new = actions.add_parser("new", help="write the YAML of a hand from its URDF, SDF or MJCF")
    new.add_argument(
        "description", metavar="FILE", help="URDF, SDF or MJCF: a path, or package://NAME/..."
    )
    new.add_argument("--output", type=Path, metavar="YAML", help="(default: NAME.yaml here)")
    new.add_argument("--name", metavar="NAME", help="of the hand (default: that of the file)")
    new.add_argument(
        "--base", metavar="LINK", help="link where the hand begins, if the file has an arm as well"
    )
    new.add_argument(
        "--tips", nargs="+", default=(), metavar="LINK", help="links of the fingertips (default:"
        " the leaves of the tree of links)"
    )  # fmt: skip
    opt.add_xacro_args(new)
    new.add_argument("--seed", type=int, default=0, metavar="N", help="random seed (default: 0)")
    new.set_defaults(execute=write_draft)
    view = actions.add_parser("view", help="write a page with frame H, pads, axes and postures")
    view.add_argument("hand", metavar="HAND", help="a name or a YAML file")
    view.add_argument("--output", type=Path, metavar="HTML", help="(default: NAME.html here)")
    view.set_defaults(execute=write_page)


def write_draft(options: argparse.Namespace) -> None:
    """Write the YAML, and print the findings on it; existing files are not replaced."""
    path = resolve_uri(options.description, Path(), "the URDF, SDF or MJCF")
    name = options.name or path.stem
    output = options.output or Path(f"{name}.yaml")
    if output.exists():
        raise InvalidFileError(f"{output} exists: name another with --output", path=output)
    draft = draft_hand(
        path,
        name=name,
        base_link=options.base,
        tips=options.tips,
        xacro_args=opt.xacro_args(options),
        rng=np.random.default_rng(options.seed),
    )
    named = options.description
    if "://" not in named:
        named = os.path.relpath(path.resolve(), output.resolve().parent)
    write_text(output, hand_yaml(draft.hand, named, draft.edits, draft.notes))
    hand = Hand.load(output)
    for note in draft.notes:
        say(f"note  {note}")
    findings = hand_findings(hand)
    say_findings(findings)
    say(f"wrote {output}: joints: {len(hand.joint_names)}, fingers: {', '.join(hand.fingers)}")
    fine = all(finding.fine for finding in findings)
    after = (
        "lis-grasp run box --hand {0}"
        if fine
        else "repair each FIX, and lis-grasp doctor --hand {0}"
    )
    say(next_step("lis-grasp hand view {0}, or: " + after, output))


def write_page(options: argparse.Namespace) -> None:
    """Write the page of a hand."""
    from lis_grasp.visualization.hand_layers import hand_page

    hand = Hand.load(options.hand)
    output = options.output or Path(f"{hand.name}.html")
    findings = hand_findings(hand)
    lines = [f"{'ok' if f.fine else 'FIX'}: {f.text}" for f in findings]
    fine = sum(f.fine for f in findings)
    headline = [(f"{fine} of {len(findings)}", "checks passed")] if fine == len(findings) else []
    headline += [(str(len(hand.joint_names)), "joints")] if headline else []
    write_text(output, hand_page(hand, headline=headline, summary=lines))
    say(f"wrote {output}")
    edited = "open {}; then edit the YAML and check it: lis-grasp doctor --hand {}"
    say(next_step(edited, output, options.hand))
