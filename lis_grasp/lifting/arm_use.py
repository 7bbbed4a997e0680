"""What a lift demanded of the arm: efforts, speeds, collisions, and the shakes that it made."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class ArmShake:
    """Peak accelerations of one shake: asked for, and made by the arm's own motion [m/s^2].

    The rest acts on the object as forces, equivalent to it in the palm's frame.
    """

    direction: str
    asked: float
    by_motion: float


@dataclass(slots=True)
class ArmUse:
    """Largest use of an arm's limits in a simulated motion, checked at every step.

    Parameters
    ----------
    effort, speed
        Largest fractions of a joint's effort and speed limits.
    effort_joint, speed_joint
        The joints that came closest to them.
    palm_error
        Largest distance of the palm from its commanded place [m].
    contact_force
        Largest force of a link of the hand on the object [N].
    steps
        Number of time steps that were checked.
    contacts
        Number of steps with a contact of each unwanted pair: ``"link with table"``, say.
    shakes
        What the arm made of each shake.
    """

    effort: float = 0.0
    effort_joint: str = ""
    speed: float = 0.0
    speed_joint: str = ""
    palm_error: float = 0.0
    contact_force: float = 0.0
    steps: int = 0
    contacts: dict[str, int] = field(default_factory=dict)
    shakes: list[ArmShake] = field(default_factory=list)
