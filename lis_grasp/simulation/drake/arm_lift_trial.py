"""Simulated lift with an arm: transit from home, the arm's shakes, checks at every step."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from lis_grasp.lifting.lift_outcome import LiftOutcome, Reason
from lis_grasp.lifting.lift_setup import LiftSetup
from lis_grasp.lifting.lift_trial import AcceptGrasp, LiftTrial
from lis_grasp.simulation.drake.arm_carrier import ArmCarrier, ArmStoppedError
from lis_grasp.simulation.drake.lift_scene import LiftScene
from lis_grasp.typing import FloatArray


class ArmLiftTrial(LiftTrial):
    """A lift whose hand is carried by an arm; see `simulate_lift`.

    The arm waits at its home until the object has settled, and moves to where the approach begins.
    After a grasp that is given up it goes back home.
    """

    def __init__(
        self,
        scene: LiftScene,
        carrier: ArmCarrier,
        setup: LiftSetup,
        accept_grasp: AcceptGrasp | None,
    ) -> None:
        super().__init__(scene, setup, accept_grasp)
        self._carrier = carrier

    def run(self) -> LiftOutcome:
        """Run the phases until one fails or all are done."""
        return replace(super().run(), arm=self._carrier.use)

    def _run_phases(self) -> Reason:
        try:
            return super()._run_phases()
        except ArmStoppedError as stopped:
            return stopped.reason

    def _rest(self, duration: float) -> None:
        self._move(self._carrier.rest(duration))

    def _approach(self) -> Reason | None:
        self._carrier.expect_contact(False)
        self._move(self._carrier.bring())
        return super()._approach()

    def _close(self) -> Reason | None:
        self._carrier.expect_contact(True)
        return super()._close()

    def _abort(self) -> Reason:
        reason = super()._abort()
        self._carrier.expect_contact(False)
        self._move(self._carrier.go_home())
        return reason

    def _shake_along(self, name: str, direction: FloatArray, acceleration: float) -> None:
        shake_with = partial(self._shake_path, direction)
        duration = self._options.shake_time
        motion = self._carrier.shake(shake_with, acceleration, duration, name)
        self._move(motion, self._hold_grip)

    def _step(self) -> None:
        super()._step()
        self._carrier.check()
