# SPDX-License-Identifier: Apache-2.0
"""Numbers of a run of the press."""

from __future__ import annotations

from math import hypot

from mech_twin.machines.crank_run import CrankRun
from mech_twin.parts.induction_motor import MotorConstants
from mech_twin.samples import Frame


class PressObserver:
    """Running numbers of a run: those of every crank machine, the largest pin force, the layer's work."""

    def __init__(self, motor: MotorConstants | None = None) -> None:
        self._run = CrankRun(motor)
        self._layer_work = 0.0

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        pins = max(hypot(pin.force_x_n, pin.force_y_n) for pin in frame.forces.wrenches)
        self._run.observe(frame, **{"pin_force_{}_n": pins})
        self._layer_work = frame.linkage.memory.as_dict()["load_work_j"]

    def numbers(self) -> dict[str, float]:
        """Return the numbers so far."""
        return {**self._run.numbers(), "run_layer_work_j": self._layer_work}
