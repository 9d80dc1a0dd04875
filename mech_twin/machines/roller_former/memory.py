"""State of the roller former that is no joint: modes, works, and the energy balance they make."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.machines.roller_former.dynamics import FormerState, Modes


class FormerMemory(NamedTuple):
    """State that is no joint.

    Works are those since the start; ``stored_energy_j`` is the energy at the sample; ``change_work_j`` what parameters
    changed while running put in.  The balance error and the turnover (sum of the sizes of all works) begin anew with
    every turn of the crank, so that neither hours nor a large sum hide an error.
    """

    motor_torque_nm: float = 0.0
    torque_known_1: float = 0.0
    command_change_1: float = 0.0
    direction_1: float = 1.0
    drive_direction_1: float = 1.0
    load_on_1: float = 0.0
    load_share_1: float = 0.0
    slow_s: float = -1.0
    stalled_1: float = 0.0
    motor_work_j: float = 0.0
    damping_work_j: float = 0.0
    load_work_j: float = 0.0
    friction_work_j: float = 0.0
    change_work_j: float = 0.0
    stored_energy_j: float = 0.0
    turn_balance_error_j: float = 0.0
    turn_turnover_j: float = 0.0

    @property
    def modes(self) -> Modes:
        """Modes of the motion; sense of the torque and first step to try are found anew in each step."""
        return Modes(
            self.direction_1,
            self.drive_direction_1,
            1.0,
            self.load_on_1 > 0.0,
            self.load_share_1,
            self.slow_s,
            self.stalled_1 > 0.0,
            0.0,
        )


def next_memory(
    past: FormerMemory,
    torque: tuple[float, float],
    modes: Modes,
    works: FormerState,
    energy: tuple[float, float],
    turned: bool,
) -> FormerMemory:
    """Return the memory after a step: torque (N m) and change of the command, modes, works and energies of the step.

    ``energy`` is what is stored before and after it (J) with the parameters of the step: what its start differs from
    the end of the step before is the work of a change of parameters.  ``turned`` begins the balance anew.
    """
    before, after = energy
    put_in, losses = works.motor_work_j, (works.damping_work_j, works.load_work_j, works.friction_work_j)
    change = before - past.stored_energy_j
    error = after - past.stored_energy_j - put_in + sum(losses) - change
    turnover = abs(put_in) + sum(abs(loss) for loss in losses) + abs(change)
    return FormerMemory(
        motor_torque_nm=torque[0],
        torque_known_1=1.0,
        command_change_1=torque[1],
        direction_1=modes.direction,
        drive_direction_1=modes.drive_direction,
        load_on_1=float(modes.load_on),
        load_share_1=modes.load_share,
        slow_s=modes.slow_s,
        stalled_1=float(modes.stalled),
        motor_work_j=past.motor_work_j + put_in,
        damping_work_j=past.damping_work_j + works.damping_work_j,
        load_work_j=past.load_work_j + works.load_work_j,
        friction_work_j=past.friction_work_j + works.friction_work_j,
        change_work_j=past.change_work_j + change,
        stored_energy_j=after,
        turn_balance_error_j=error + (0.0 if turned else past.turn_balance_error_j),
        turn_turnover_j=turnover + (0.0 if turned else past.turn_turnover_j),
    )
