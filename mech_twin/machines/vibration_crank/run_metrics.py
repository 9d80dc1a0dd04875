# SPDX-License-Identifier: Apache-2.0
"""Numbers of a run of the vibration crank."""

from __future__ import annotations

from mech_twin.machines.crank_run import CrankRun
from mech_twin.parts.induction_motor import MotorConstants
from mech_twin.samples import Frame


class VibrationCrankObserver:
    """Running numbers of a run: those of every crank machine, and the force on the frame."""

    def __init__(self, motor: MotorConstants | None = None) -> None:
        self._run = CrankRun(motor)

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        force = frame.forces.quantities.as_dict()["shaking_force_n"]
        self._run.observe(frame, **{"shaking_force_{}_n": force})

    def numbers(self) -> dict[str, float]:
        """Return the numbers so far; the torque's peak is its greatest size."""
        out = self._run.numbers()
        if out:
            out["run_drive_torque_peak_nm"] = max(
                abs(out["run_drive_torque_min_nm"]), abs(out["run_drive_torque_max_nm"])
            )
        return out
