"""Joints of an MJCF that are driven, that follow another, or that rest (compiled by MuJoCo)."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidHandError

_LINEAR = 1e-9  # coefficients of higher powers of a coupling that count as 0


def mjt_name(enumeration: str, number: int) -> str:
    """Return the name of one of MuJoCo's kinds in small letters, as "hinge" of "Joint"."""
    import mujoco

    return str(getattr(mujoco, f"mjt{enumeration}")(int(number)).name).split("_")[1].lower()


def name_of(model: Any, kind: str, number: int) -> str:
    """Return the name of a body, joint, tendon or equality, or its kind and number."""
    return getattr(model, kind)(number).name or f"{kind}_{number}"


class Couplings:
    """What moves each joint of some bodies.

    ``efforts`` has the driven joints (None where the file gives no effort), ``followers`` the
    leader, multiplier and offset of the coupled ones, and ``rests`` the positions of all others;
    ``notes`` says what was decided. A tendon of several joints couples them by its coefficients.

    Raises `InvalidHandError` for closed chains, tendons over sites, and couplings that are not
    linear or of more than two joints.
    """

    def __init__(self, model: Any, bodies: Collection[int]) -> None:
        self._m, self._bodies = model, bodies
        self.efforts: dict[int, float | None] = {}
        self.followers: dict[int, tuple[int, float, float]] = {}
        self.rests: dict[int, float] = {}
        self.notes: list[str] = []
        joints = [j for j in range(model.njnt) if model.jnt_bodyid[j] in bodies]
        own = [j for j in joints if mjt_name("Joint", model.jnt_type[j]) != "free"]  # a base's
        self._driven = {int(model.actuator_trnid[a, 0]) for a in range(model.nu) if self._direct(a)}
        for equality in range(model.neq):
            self._couple(equality)
        if model.nu == 0:
            self.efforts = dict.fromkeys(own)
        for actuator in range(model.nu):
            self._drive(actuator)
        moved = {*self.efforts, *self.followers, *self.rests}
        for joint in (j for j in own if j not in moved):
            rest = float(model.qpos_spring[model.jnt_qposadr[joint]])
            if model.jnt_limited[joint]:
                rest = float(np.clip(rest, *model.jnt_range[joint]))
            self.rests[joint] = rest
            name = name_of(model, "joint", joint)
            self.notes.append(f"joint {name} has no actuator, and is fixed at {rest:.3g}")

    def _couple(self, equality: int) -> None:
        m, kind = self._m, mjt_name("Eq", self._m.eq_type[equality])
        first, second = int(m.eq_obj1id[equality]), int(m.eq_obj2id[equality])
        name = name_of(m, "equality", equality)
        if kind in ("connect", "weld"):
            if mjt_name("Obj", m.eq_objtype[equality]) == "site":
                first, second = int(m.site_bodyid[first]), int(m.site_bodyid[second])
            if {first, second} <= set(self._bodies):
                ends = " and ".join(name_of(m, "body", body) for body in (first, second))
                raise InvalidHandError(
                    f"the joints must form a tree; {name} closes a chain between {ends}: give a"
                    " URDF with mimicking joints"
                )
        elif kind == "joint":
            powers = m.eq_data[equality, :5]
            if np.abs(powers[2:]).max() > _LINEAR:
                raise InvalidHandError(
                    f"{name} of joint '{name_of(m, 'joint', first)}' must be linear; it has higher"
                    " powers"
                )
            terms = {first: 1.0}
            if second >= 0:
                terms[second] = -float(powers[1])
            self._follow(terms, float(powers[0]), name)
        elif kind == "tendon" and second < 0:
            self._follow(self._pulled(first), float(m.eq_data[equality, 0]), name)

    def _follow(self, terms: dict[int, float], constant: float, name: str) -> None:
        """Read ``sum coefficient * (q - q0) = constant``: the joint without actuator follows."""
        m = self._m
        own = {j: c for j, c in terms.items() if abs(c) > _LINEAR}
        if not own or any(m.jnt_bodyid[j] not in self._bodies for j in own):
            return
        if len(own) > 2:
            raise InvalidHandError(f"{name} must couple one or two joints; it couples {len(own)}")
        follower = min(own, key=lambda j: (j in self._driven, j in self.followers))
        offset = float(m.qpos0[m.jnt_qposadr[follower]]) + constant / own[follower]
        for leader in own.keys() - {follower}:
            multiplier = -own[leader] / own[follower]
            offset -= multiplier * float(m.qpos0[m.jnt_qposadr[leader]])
            self.followers[follower] = leader, multiplier, offset
        if len(own) == 1:
            self.rests[follower] = offset

    def _direct(self, actuator: int) -> bool:
        return mjt_name("Trn", self._m.actuator_trntype[actuator]).startswith("joint")

    def _pulled(self, tendon: int) -> dict[int, float]:
        """Return the joints of a fixed tendon with their coefficients."""
        m, first = self._m, int(self._m.tendon_adr[tendon])
        wraps = range(first, first + int(m.tendon_num[tendon]))
        if any(mjt_name("Wrap", m.wrap_type[w]) != "joint" for w in wraps):
            raise InvalidHandError(
                f"tendon '{name_of(m, 'tendon', tendon)}' must be of joints with coefficients; it"
                " runs over sites, so that no joint position follows from another: give a URDF"
            )
        return {int(m.wrap_objid[w]): float(m.wrap_prm[w]) for w in wraps}

    def _drive(self, actuator: int) -> None:
        """Note the joint that an actuator moves; others that its tendon pulls follow that one."""
        m, target = self._m, int(self._m.actuator_trnid[actuator, 0])
        if self._direct(actuator):
            terms = {target: 1.0}
        elif mjt_name("Trn", m.actuator_trntype[actuator]) == "tendon":
            terms = self._pulled(target)
        else:
            return
        levers: dict[int, float] = {}
        for joint, coefficient in terms.items():
            if m.jnt_bodyid[joint] in self._bodies:
                leader, ratio = self._leader(joint)
                levers[leader] = levers.get(leader, 0.0) + ratio * coefficient
        idle = [j for j, lever in levers.items() if j not in self.efforts and lever]
        if not idle:
            return
        for other in idle[1:]:
            self.followers[other] = idle[0], levers[other] / levers[idle[0]], 0.0
        if len(idle) > 1:
            names = ", ".join(name_of(m, "joint", j) for j in idle)
            self.notes.append(f"one tendon pulls the joints {names}, which are coupled evenly")
        lever = sum(levers[j] ** 2 for j in idle) / abs(levers[idle[0]])
        self.efforts[idle[0]] = self._effort(actuator, idle[0], lever)

    def _leader(self, joint: int) -> tuple[int, float]:
        """Return the joint that a joint follows, or itself, and the ratio of their motions."""
        ratio = 1.0
        for _ in range(self._m.njnt):
            if joint not in self.followers:
                break
            joint, multiplier, _ = self.followers[joint]
            ratio *= multiplier
        return joint, ratio

    def _effort(self, actuator: int, joint: int, lever: float) -> float | None:
        """Return the largest effort of an actuator at a joint; None where the file gives none."""
        m = self._m
        efforts = []
        gear = abs(float(m.actuator_gear[actuator, 0])) * lever
        if m.actuator_forcelimited[actuator]:
            efforts.append(gear * float(np.abs(m.actuator_forcerange[actuator]).max()))
        elif m.actuator_ctrllimited[actuator] and not m.actuator_biastype[actuator]:
            gain = abs(float(m.actuator_gainprm[actuator, 0]))
            efforts.append(gear * gain * float(np.abs(m.actuator_ctrlrange[actuator]).max()))
        if m.jnt_actfrclimited[joint]:
            efforts.append(float(np.abs(m.jnt_actfrcrange[joint]).max()))
        return min(efforts, default=None)
