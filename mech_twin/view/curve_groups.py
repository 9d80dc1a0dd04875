# SPDX-License-Identifier: Apache-2.0
"""Time series of the samples, in groups (one quantity of all joints, one component of all pins)."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.declarations.captions import caption, titled
from mech_twin.samples import BodySample, ForceSample, LinkageSample, MotorSample

RESIDUAL_FLOOR = 1e-18
UNITLESS = "number"
# what derived quantities are by their unit, the most relevant first
QUANTITIES = {"W": "Power", "J": "Energy", "m": "Lengths", "m/s": "Further speeds", "N s": "Impulses"}


class Group(NamedTuple):
    """Curves with common time stamps: entity path, names, and values of shape (n, k)."""

    path: str
    names: tuple[str, ...]
    values: npt.NDArray[np.float64]
    unit: str = ""


Groups = list[Group]


def quantity_path(unit: str) -> str:
    """Return the entity path of the derived quantities of a unit: ``quantities/n_m`` for N m."""
    word = unit.replace("²", "2").replace("³", "3").replace("/", " per ").replace("%", "percent").lower()
    return "quantities/" + ("_".join(word.split()) or UNITLESS)


MOMENTS, FORCES = quantity_path("N m"), quantity_path("N")


def motor_groups(samples: Sequence[MotorSample], sliding: frozenset[str] = frozenset()) -> Groups:
    """Return speed and torque of the drive (force of a linear drive), and the fraction of rated supply frequency."""
    joints = samples[0].joints
    columns = {
        "torque": _rows([sample.effort for sample in samples]),
        "speed": _rows([sample.velocity for sample in samples]),
    }
    return [
        *_by_unit_of_joint("motor", joints, columns, sliding),
        Group("motor/supply", ("supply fraction",), _rows([(sample.command,) for sample in samples])),
    ]


def linkage_groups(samples: Sequence[LinkageSample], sliding: frozenset[str] = frozenset()) -> Groups:
    """Return position, speed and effort of every joint, prismatic joints (m) in separate groups, and the residuals."""
    joints = samples[0].joints
    columns = {
        "position": _rows([sample.position for sample in samples]),
        "speed": _rows([sample.velocity for sample in samples]),
        "effort": _rows([sample.effort for sample in samples]),
    }
    return [*_by_unit_of_joint("linkage", joints, columns, sliding), *_residuals("linkage", samples)]


def force_groups(samples: Sequence[ForceSample]) -> Groups:
    """Return magnitude and components of every pin reaction, and the derived quantities grouped by unit."""
    pins = samples[0].pins
    wrenches = np.array([sample.wrenches for sample in samples], dtype=np.float64).reshape(len(samples), len(pins), 3)
    force_x_n, force_y_n = wrenches[:, :, 0], wrenches[:, :, 1]
    groups = [
        Group("pins/magnitude", pins, np.hypot(force_x_n, force_y_n)),
        Group("pins/force_x", pins, force_x_n),
        Group("pins/force_y", pins, force_y_n),
        Group("body_moment", ("moment on the body",), _rows([(sample.body_moment_nm,) for sample in samples])),
    ]
    names = samples[0].quantities.names
    values = _rows([sample.quantities.values for sample in samples])
    for unit, columns in by_unit(names).items():
        chosen = tuple(caption(names[column])[0] for column in columns)
        groups.append(Group(quantity_path(unit), chosen, values[:, columns], unit=unit))
    return [*groups, *_residuals("forces", samples)]


def body_groups(samples: Sequence[BodySample]) -> Groups:
    """Return position, speed and spring moment of the body, its pressing force, and the residuals."""
    joints = samples[0].joints
    return [
        Group("body/position", joints, _rows([sample.position for sample in samples])),
        Group("body/speed", joints, _rows([sample.velocity for sample in samples])),
        Group("body/effort", joints, _rows([sample.effort for sample in samples])),
        Group("body/pressing_force", ("pressing force",), _rows([(sample.pressing_force_n,) for sample in samples])),
        *_residuals("body", samples),
    ]


def by_unit(names: Sequence[str]) -> dict[str, list[int]]:
    """Return, for each unit, the indices of the names with that unit."""
    places: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        places.setdefault(caption(name)[1], []).append(place)
    return places


def _by_unit_of_joint(
    role: str, joints: tuple[str, ...], columns: Mapping[str, npt.NDArray[np.float64]], sliding: frozenset[str]
) -> Groups:
    """Return the columns of the revolute joints, and in separate groups those of the prismatic joints."""
    groups = []
    for path, slides in ((role, False), (f"{role}_sliding", True)):
        places = [place for place, joint in enumerate(joints) if (joint in sliding) == slides]
        chosen = tuple(joints[place] for place in places)
        groups += [Group(f"{path}/{kind}", chosen, values[:, places]) for kind, values in columns.items()]
    return groups


def _rows(values: Sequence[tuple[float, ...]]) -> npt.NDArray[np.float64]:
    return np.array(values, dtype=np.float64).reshape(len(values), -1)


def _residuals(role: str, samples: Sequence[Any]) -> Groups:
    """Return the decimal logarithm of the residuals, so that 1e-16 and 1e-9 are both visible."""
    names = samples[0].residuals.names
    if not names:
        return []
    values = np.abs(_rows([sample.residuals.values for sample in samples]))
    labels = tuple(f"log10 {titled(name)}" for name in names)
    return [Group(f"residuals/{role}", labels, np.log10(np.maximum(values, RESIDUAL_FLOOR)))]


def same_names(one: Any, other: Any) -> bool:
    """Return whether two samples of a role have the same names and thus belong to the same curves."""
    return _names(one) == _names(other)


def _names(sample: Any) -> tuple[tuple[str, ...], ...]:
    """Return the names of a sample's values; those of one run are the same tuples, which compare at once."""
    if isinstance(sample, MotorSample):
        return (sample.joints,)
    if isinstance(sample, ForceSample):
        return sample.pins, sample.quantities.names, sample.residuals.names
    return sample.joints, sample.residuals.names


def present(curves: Mapping[str, tuple[str, ...]], *prefixes: str) -> list[str]:
    """Return the entity paths that lie under any of the prefixes."""
    return [path for path in curves if any(path == prefix or path.startswith(prefix + "/") for prefix in prefixes)]


def plots(curves: Mapping[str, tuple[str, ...]], units: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the entity paths of the plots of a run by title, the most relevant first; names and units are by path."""
    known = {quantity_path(unit): f"{name}, {unit}" for unit, name in QUANTITIES.items()}
    rest = [path for path in present(curves, "quantities") if path not in (MOMENTS, FORCES, *known)]
    # without a body the moment on it is zero
    moment = present(curves, "body_moment", "body/effort") if present(curves, "body") else []
    every = {
        "Pressing force, N": present(curves, "body/pressing_force"),
        "Pin reactions, N": present(curves, "pins/magnitude"),
        "Torque, N m": [*present(curves, "motor/torque"), *present(curves, MOMENTS)],
        "Speed, rad/s": present(curves, "motor/speed", "linkage/speed"),
        "Speed, m/s": present(curves, "motor_sliding/speed", "linkage_sliding/speed"),
        "Force of the drive, N": present(curves, "motor_sliding/torque"),
        "Forces, N": present(curves, FORCES),
        **{title: present(curves, path) for path, title in known.items()},
        **{f"Quantities, {units.get(path) or UNITLESS}": [path] for path in rest},
        "Position, rad": present(curves, "linkage/position"),
        "Position, m": present(curves, "linkage_sliding/position"),
        "Body position, rad": present(curves, "body/position"),
        "Body speed, rad/s": present(curves, "body/speed"),
        "Moment on the body, N m": moment,
        "Effort of the joints, N m": present(curves, "linkage/effort"),
        "Effort of the joints, N": present(curves, "linkage_sliding/effort"),
        "Pin reactions along x, N": present(curves, "pins/force_x"),
        "Pin reactions along y, N": present(curves, "pins/force_y"),
        "Supply, share of rated": present(curves, "motor/supply"),
        "Residuals, powers of ten": present(curves, "residuals"),
    }
    return {title: paths for title, paths in every.items() if paths}
