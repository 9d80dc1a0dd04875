# SPDX-License-Identifier: Apache-2.0
"""Faults of a machine as changes of its parameters, each with a size, and operating variables of a healthy one.

An operating variable (supply, load, temperature, tolerance) moves within a range; beyond it is a fault.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from mech_twin.declarations.configuration_tree import configuration_tree, value_in
from mech_twin.declarations.quantity import Parameters

# usual sizes of a fault that is a share of a healthy value: a loss, or a change either way
LESS = (-0.6, -0.5, -0.4, -0.3, -0.2, -0.1, -0.05)
EITHER = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)
MORE = (0.25, 0.5, 1.0, 2.0, 4.0)
BEYOND = (-0.2, -0.15, -0.1, -0.07, 0.07, 0.1, 0.15, 0.2)  # a supply beyond its range
FREQUENCY = "supply_frequency_range"  # the fault of its frequency


class MachineFault(NamedTuple):
    """A fault of a machine.

    Attributes
    ----------
    name, meaning : str
        Name, and a description of one line for the operator.
    unit : str
        Unit of the size: ``1`` if it is a share of the healthy value.
    sizes : tuple of float
        Ascending sizes at which its effect is computed; between them it is interpolated, with 0 at size 0.
    changes : callable
        ``changes(parameters, size)``: configuration keys (dotted) and their values under the fault.
    key : str
        The key that changes, if it is a single one; empty otherwise.
    """

    name: str
    meaning: str
    unit: str
    sizes: tuple[float, ...]
    changes: Callable[[Any, float], Mapping[str, Any]]
    key: str = ""


def value_at(parameters: Parameters, key: str) -> Any:
    """Return the value of a dotted key."""
    return value_in(configuration_tree(parameters), key)


def _by_share(keys: Sequence[str], parameters: Parameters, share: float) -> dict[str, Any]:
    return {key: float(value_at(parameters, key)) * (1.0 + share) for key in keys}


def share_of_key(name: str, meaning: str, key: str, sizes: Sequence[float]) -> MachineFault:
    """Return a fault that changes a key by a share of its healthy value."""
    return MachineFault(name, meaning, "1", tuple(sizes), partial(_by_share, (key,)), key=key)


def added_to_key(name: str, meaning: str, key: str, unit: str, sizes: Sequence[float]) -> MachineFault:
    """Return a fault that adds its size to a key."""
    return MachineFault(
        name, meaning, unit, tuple(sizes), lambda parameters, size: {key: float(value_at(parameters, key)) + size}, key
    )


def rod_faults(rod: Any, key: str, weak_key: str, prefix: str = "") -> tuple[MachineFault, ...]:
    """Return the faults of a struck rod, the group ``key``; ``weak_key`` is the force of a wall that yields."""
    found = []
    if rod.face.kind == "linear":
        worn = f"{key}.face.stiffness_n_per_m"
        found.append(share_of_key(f"{prefix}face_worn", "the struck face is softer", worn, LESS))
    if rod.foot.length_m > 0.0:
        play = (1e-4, 2e-4, 5e-4)
        found.append(added_to_key(f"{prefix}foot_worn", "the foot has play", f"{key}.foot_gap_m", "m", play))
    if rod.wall.kind == "loading":
        soft = f"{key}.wall.stiffness_n_per_m"
        found.append(share_of_key(f"{prefix}wall_soft", "the wall is softer", soft, LESS))
    if rod.wall.kind == "yielding":
        found.append(share_of_key(f"{prefix}wall_weak", "the wall gives way sooner", weak_key, LESS))
    return tuple(found)


class OperatingVariable(NamedTuple):
    """A quantity that may vary within its range without being a fault.

    Attributes
    ----------
    name, meaning : str
        Name, and a description of one line for the operator.
    range : float
        Half-width of the range, as a share of the healthy value.
    changes : callable
        ``changes(parameters, share)``: configuration keys (dotted) and their values at that share.
    beyond : str
        Name of the fault that it is outside its range.
    is_commanded : bool
        Whether the command of a run has the same effect as ``changes``.
    """

    name: str
    meaning: str
    range: float
    changes: Callable[[Any, float], Mapping[str, Any]]
    beyond: str
    is_commanded: bool = False


def varying_key(
    name: str, meaning: str, key: str, share: float, beyond: str, *more: str, is_commanded: bool = False
) -> OperatingVariable:
    """Return a variable that changes a key, and further ones with it, by a share of the healthy value."""
    return OperatingVariable(name, meaning, share, partial(_by_share, (key, *more)), beyond, is_commanded)


def beyond_range(variable: OperatingVariable) -> MachineFault:
    """Return the fault that a variable of the supply is outside its range, on either side."""
    meaning = f"{variable.meaning}, beyond its range"
    return MachineFault(variable.beyond, meaning, "1", BEYOND, variable.changes)


def prescribed_speed(*keys: str) -> OperatingVariable:
    """Return the frequency of a supply that prescribes speeds as an operating variable."""
    key, *more = keys
    return varying_key(
        "supply_frequency", "frequency of the supply", key, FREQUENCY_RANGE, FREQUENCY, *more, is_commanded=True
    )


FREQUENCY_RANGE, VOLTAGE_RANGE, RESISTANCE_RANGE = 0.05, 0.05, 0.16  # the last: 40 K of copper temperature


def motor_changes(
    parameters: Parameters, key: str = "motor", *, torque: float = 1.0, slip: float = 1.0, field: float = 1.0
) -> dict[str, Any]:
    """Return the changed keys of an induction motor for factors of its torque, slip speed and synchronous speed.

    Printed values are scaled too; the catalogue name is removed.
    """
    motor = value_at(parameters, key)
    synchronous, rated = float(motor["synchronous_speed_rpm"]), float(motor["rated_speed_rpm"])
    rated_later = field * synchronous - slip * (synchronous - rated)
    found = {
        "catalogue_name": None,
        "synchronous_speed_rpm": field * synchronous,
        "rated_speed_rpm": rated_later,
        "rated_power_w": float(motor["rated_power_w"]) * torque * rated_later / rated,
    }
    printed = {"rated_torque_nm": torque, "breakdown_torque_nm": torque, "breakdown_slip": slip / field}
    found |= {name: motor[name] * share for name, share in printed.items() if motor.get(name) is not None}
    return {f"{key}.{name}": value for name, value in found.items()}


def motor_variables(*motors: str) -> tuple[OperatingVariable, ...]:
    """Return supply frequency and voltage, and rotor resistance of induction motors as operating variables.

    ``motors`` are the keys of the motors on one supply, ``motor`` if none is given.

    Voltage is proportional to frequency, as with a converter and nearly so in a weak grid: flux, and torque at a slip
    in rad/s, are constant.  Torque at every slip is proportional to the square of the voltage; the slip at a torque is
    proportional to the resistance.
    """

    def changes(parameters: Parameters, **factors: float) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key in motors or ("motor",):
            found |= motor_changes(parameters, key, **factors)
        return found

    return (
        OperatingVariable(
            "supply_frequency", "frequency of the supply", FREQUENCY_RANGE,
            lambda parameters, share: changes(parameters, field=1.0 + share), FREQUENCY,
        ),
        OperatingVariable(
            "supply_voltage", "voltage of the supply", VOLTAGE_RANGE,
            lambda parameters, share: changes(parameters, torque=(1.0 + share) ** 2), "supply_voltage_range",
        ),
        OperatingVariable(
            "rotor_resistance", "resistance of the motor's rotor, by its temperature", RESISTANCE_RANGE,
            lambda parameters, share: changes(parameters, slip=1.0 + share), "rotor_resistance_range",
        ),
    )  # fmt: skip


def drive_variables(kind: str) -> tuple[OperatingVariable, ...]:
    """Return the operating variables of a crank's drive: those of the motor, or the speed if it is prescribed."""
    if kind == "kloss":
        return motor_variables()
    return (prescribed_speed("drive.speed_rpm"),)
