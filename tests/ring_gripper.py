"""URDFs of grippers with equal fingers: three on a ring about the palm's axis."""

import numpy as np

INERTIA = '<inertia ixx="6e-05" iyy="6e-05" izz="6e-05" ixy="0" ixz="0" iyz="0"/>'
LIMITS = (0.0, 0.6)
TIP, RING = 0.009, 0.06


def link(name: str, shape: str, height: float = 0.0) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="0.05"/>{INERTIA}</inertial>'
        f'<collision><origin xyz="0 0 {height}"/><geometry>{shape}</geometry></collision></link>'
    )


def joint(name: str, parent: str, child: str, kind: str, xyz: str, *, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin {xyz}/><parent link="{parent}"/>'
        f'<child link="{child}"/>{more}</joint>'
    )


def three_fingers(limits: tuple[float, float] = LIMITS) -> str:
    """Return a hand of three fingers on a ring about z, whose pads are 96 mm apart if opened."""
    parts = [link("base", '<cylinder radius="0.06" length="0.04"/>')]
    low, high = limits
    moves = f'<axis xyz="0 -1 0"/><limit lower="{low}" upper="{high}" effort="1.5" velocity="3"/>'
    for i, angle in enumerate(np.linspace(0.0, 2.0 * np.pi, 3, endpoint=False)):
        at = f'xyz="{RING * np.cos(angle)} {RING * np.sin(angle)} 0.02" rpy="0 0 {angle}"'
        parts += [
            link(f"finger{i}", '<box size="0.012 0.014 0.09"/>', 0.045),
            joint(f"j{i}", "base", f"finger{i}", "revolute", at, more=moves),
            link(f"tip{i}", f'<sphere radius="{TIP}"/>'),
            joint(f"t{i}", f"finger{i}", f"tip{i}", "fixed", 'xyz="-0.003 0 0.1"'),
        ]
    return f'<robot name="tri">{"".join(parts)}</robot>'
