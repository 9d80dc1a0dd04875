# SPDX-License-Identifier: Apache-2.0
"""The simulated machines of the monitor's proof: settings, sensors, a wandering supply, healthy and faulty cycles."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from mech_twin.capabilities.faults import MachineFault
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.measurements.measurement_map import read_map
from mech_twin.parameters.load import machine_parameters
from mech_twin.results.opened_runs import columns_of
from mech_twin.studies.monitoring.cycle_features import FeatureVector, feed_channels
from mech_twin.studies.monitoring.sensing import MonitoredMachine, needed_columns, seen_roll_out

SENSORS = Path(__file__).parent / "sensors"
SETTINGS: dict[str, dict[str, Any]] = {
    # a press with a motor and a flywheel: at prescribed speed neither could fail
    "compaction_press": {
        "drive.kind": "kloss",
        "motor.rated_power_w": 3000.0,
        "motor.rated_speed_rpm": 1420.0,
        "motor.synchronous_speed_rpm": 1500.0,
        "motor.breakdown_torque_ratio": 2.4,
        "motor.starting_torque_ratio": 2.0,
        "motor.rotor_inertia_kg_m2": 0.01,
        "gear.ratio": 4.7,
        "gear.efficiency": 0.96,
        "flywheel.inertia_kg_m2": 2.0,
    },
    # a step that is no part of the period: else the switching of the force falls on steps, and rounding decides which
    "impact_mass": {"coupling.step_s": 0.00023},
}
WANDER, WANDER_S = 5e-4, 20.0  # standard deviation and time constant of the supply's wander
RUN_S = 100.0
SLICE_S = 10.0  # fed at once; what comes out does not depend on it
PACKAGE_S = 60.0  # of a winding drum, whose package runs off
BEFORE, AFTER = 30, 80  # cycles before and after a change
SHARE_OF_SIZE = 0.8  # off the sizes that signatures are computed at
FAR = 1000  # cycles left out between two runs, so that none is taken for the other's next


def monitored_machine(name: str) -> MonitoredMachine:
    """Return the machine with its sensors."""
    parameters = machine_parameters(name, None, SETTINGS.get(name))
    return MonitoredMachine(name, parameters, read_map(SENSORS / f"{name}.yaml", columns_of))


def wander(steps: int, step_s: float, random: np.random.Generator, first: float = 0.0) -> np.ndarray:
    """Return a supply fraction near 1 that wanders: an Ornstein-Uhlenbeck process, a knot every tenth of a second.

    A drive gives no more than what is configured: what is above 1 counts as 1, where nothing else moves the supply.
    """
    knots = int(np.ceil(steps * step_s / 0.1)) + 2
    decay, values = np.exp(-0.1 / WANDER_S), np.empty(knots)
    values[0] = first
    for i, shock in enumerate(random.standard_normal(knots - 1), 1):
        values[i] = decay * values[i - 1] + WANDER * np.sqrt(1.0 - decay * decay) * shock
    return 1.0 + np.interp(step_s * np.arange(steps + 1), 0.1 * np.arange(knots), values)


def steps_of_motion(machine: MonitoredMachine) -> int:
    """Return the steps of a motion, its run-up before it."""
    longest_s = PACKAGE_S if machine.name == "winding_drum" else RUN_S
    return ceil((machine.declared.run_up_s + longest_s) / machine.entry.build(machine.parameters).coupling_step_s)


def healthy_run(machine: MonitoredMachine, random: np.random.Generator) -> RollOut:
    """Return a healthy motion, its run-up before it."""
    built = machine.entry.build(machine.parameters)
    steps = steps_of_motion(machine)
    command = wander(steps, built.coupling_step_s, random, WANDER * random.standard_normal())
    run = roll_out(
        built, steps * built.coupling_step_s, needed_columns(machine.sensors), None, np.minimum(command, 1.0)
    )
    if run.error is not None:
        raise run.error
    return run


def seen_vectors(machine: MonitoredMachine, run: RollOut, random: np.random.Generator) -> list[FeatureVector]:
    """Return the features of a motion beyond the run-up, seen through fresh noise."""
    step_s, begin_s = machine.entry.build(machine.parameters).coupling_step_s, machine.declared.run_up_s
    return feed_channels(machine.feed(), seen_roll_out(run, machine.sensors, step_s, random, begin_s), SLICE_S)


def healthy_cycles(machine: MonitoredMachine, count: int, random: np.random.Generator) -> list[FeatureVector]:
    """Return at least so many healthy cycles, run after run, each run's cycles numbered apart from the others'."""
    found: list[FeatureVector] = []
    while len(found) < count:
        vectors = seen_vectors(machine, healthy_run(machine, random), random)
        first = found[-1].number + FAR if found else 0
        found += [vector._replace(number=first + vector.number) for vector in vectors]
    return found


def three_sizes(fault: MachineFault) -> list[float]:
    """Return a small, a middle and a large size, of one sign."""
    sizes = sorted(fault.sizes, key=abs)
    if len(sizes) == 1:
        return sizes
    same = [size for size in sizes if (size > 0.0) == (sizes[0] > 0.0)]
    if len(same) == 2:
        same.insert(1, 0.5 * (same[0] + same[1]))
    return [SHARE_OF_SIZE * same[place] for place in (0, len(same) // 2, -1)]


def faulty_run(
    machine: MonitoredMachine, fault: MachineFault, size: float, period_s: float, random: np.random.Generator
) -> tuple[RollOut, float] | None:
    """Return a roll-out with the fault from a random instant of a cycle on, and that instant; None without a motion."""
    healthy = machine.entry.build(machine.parameters)
    faulty = machine.entry.build(machine.varied(fault.changes(machine.parameters, size)))
    step_s, begin_s = healthy.coupling_step_s, machine.declared.run_up_s
    change_s = begin_s + (BEFORE + random.random()) * period_s
    duration_s = change_s + (AFTER + 2) * period_s
    command = wander(round(duration_s / step_s), step_s, random)
    command = np.minimum(command, 1.0)
    run = roll_out(healthy, duration_s, needed_columns(machine.sensors), None, command, [(change_s, faulty)])
    return None if run.error is not None else (run, change_s)
