# SPDX-License-Identifier: Apache-2.0
"""The operating points of a machine by roll-out: which variables its sensors see, what they do, and how it settles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from pydantic import ValidationError

from mech_twin.capabilities.cycle import Array
from mech_twin.capabilities.operating_point import OperatingVariable
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.errors import MotionError
from mech_twin.engine.rollout import roll_out
from mech_twin.studies.monitoring.baseline import RIDGE, SMALLEST_SPREAD
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.operating import (
    OperatingSurface,
    SurfaceVariable,
    chosen_variables,
    fitted_surface,
    with_baseline,
    with_transients,
)
from mech_twin.studies.monitoring.sensing import needed_columns, seen_roll_out
from mech_twin.studies.monitoring.signatures import MonitoredMachine, mean_period_s, noisy_draws, steady_cycles

USED_CYCLES = 60  # at the end of a roll-out, whose mean counts
SETTLED_CYCLES = 25  # before them
STEP = 0.4  # of a range, for the transient
STEP_DRAWS = 4


def operating_surface(
    monitored: MonitoredMachine,
    vectors: Sequence[FeatureVector],
    names: tuple[str, ...],
) -> OperatingSurface | None:
    """Return the operating points of a machine for these features; None where it declares none that its sensors see.

    Parameters
    ----------
    monitored : MonitoredMachine
        The machine and its sensors.
    vectors : sequence of FeatureVector
        Healthy cycles.
    names : tuple of str
        Features.
    """
    declared = monitored.operating
    if not declared:
        return None
    rows, root = _rows(vectors, names), _root_of_noise(vectors, names)
    duration_s = monitored.declared.run_up_s + (SETTLED_CYCLES + USED_CYCLES) * mean_period_s(monitored)

    def features_at(parameters: Parameters | None) -> Array | None:
        return _features_at(monitored, parameters, duration_s, names)

    reference = features_at(monitored.parameters)
    if reference is None:
        return None
    everywhere: dict[int, Array] = {}
    for i, variable in enumerate(declared):
        either = [
            features_at(parameters_at(monitored.parameters, [variable], [side * variable.range]))
            for side in (-1.0, 1.0)
        ]
        if either[0] is not None and either[1] is not None:
            everywhere[i] = 0.5 * (either[1] - either[0])
    usable = [declared[i] for i in everywhere]
    if not usable:
        return None
    variables = [SurfaceVariable(each.name, each.beyond, each.range) for each in usable]
    kept, groups, unexplained = chosen_variables(variables, np.array(list(everywhere.values())), root)
    if not kept:
        return None
    chosen = [usable[i] for i in kept]

    def rolled_out(shares: Array) -> Array | None:
        found = features_at(parameters_at(monitored.parameters, chosen, shares))
        return None if found is None else found - reference

    surface = fitted_surface(groups, rolled_out, names, rows, root, unexplained)
    return _settling(monitored, surface, chosen, duration_s)


def sister_surface(surface: OperatingSurface, vectors: Sequence[FeatureVector]) -> OperatingSurface:
    """Return the surface about the healthy cycles of another machine of the same numbers and sensors."""
    rows, root = _rows(vectors, surface.names), _root_of_noise(vectors, surface.names)
    return replace(surface, root=root).centred(rows)


def left_by_point(
    surface: OperatingSurface, vectors: Sequence[FeatureVector]
) -> tuple[OperatingSurface, list[FeatureVector]]:
    """Return the surface with the wander of a baseline, and what its operating point leaves of each cycle."""
    found, runs, number = list[FeatureVector](), list[list[Array]](), None
    for vector in vectors:
        left, point = surface.reduced(vector)
        found.append(left)
        if not np.isfinite(point).all():
            continue
        if number is None or vector.number != number + 1:
            runs.append([])
        runs[-1].append(point)
        number = vector.number
    return with_baseline(surface, [np.array(run) for run in runs]), found


def parameters_at(
    parameters: Parameters, variables: Iterable[OperatingVariable], shares: Iterable[float]
) -> Parameters | None:
    """Return the configuration at an operating point; None where it is refused."""
    try:
        for variable, share in zip(variables, shares, strict=True):
            parameters = varied(parameters, variable.changes(parameters, float(share)))
    except ValidationError:
        return None
    return parameters


def _features_at(
    monitored: MonitoredMachine, parameters: Parameters | None, duration_s: float, names: tuple[str, ...]
) -> Array | None:
    """Return the mean features of steady running; None where the machine does not run so."""
    if parameters is None:
        return None
    try:
        found = steady_cycles(monitored, noisy_draws(monitored, parameters, 1.0, duration_s), names, USED_CYCLES)
    except MotionError:
        return None
    return None if found is None else found.mean


def _rows(vectors: Sequence[FeatureVector], names: tuple[str, ...]) -> Array:
    places = [vectors[0].names.index(name) for name in names]
    rows = np.array([vector.values[places] for vector in vectors])
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])


def _root_of_noise(vectors: Sequence[FeatureVector], names: tuple[str, ...]) -> Array:
    """Return L^-1 with L L' half the covariance of the differences of neighbouring cycles."""
    rows = _rows(vectors, names)
    steps = np.diff(rows, axis=0)
    found = 0.5 * steps.T @ steps / max(len(steps) - 1, 1)
    floor = np.maximum(SMALLEST_SPREAD * np.abs(rows.mean(axis=0)), 1e-12) ** 2
    spread = np.maximum(np.diag(found), floor)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(found + np.diag(spread - np.diag(found) + RIDGE * spread))))


def _settling(
    monitored: MonitoredMachine, surface: OperatingSurface, chosen: Sequence[OperatingVariable], duration_s: float
) -> OperatingSurface:
    """Return the surface with its transients: each variable stepped in a run of its own."""
    begin_s, healthy = monitored.declared.run_up_s, monitored.entry.build(monitored.parameters)
    change_s = begin_s + 0.3 * (duration_s - begin_s)
    runs, noise = [], np.zeros(len(surface.others))
    for k, variable in enumerate(chosen):
        share = STEP * float(surface.ranges[k])
        later = parameters_at(monitored.parameters, [variable], [-share])
        if later is None:
            runs.append((np.zeros((1, len(noise))), np.zeros((1, len(chosen)))))
            continue
        run = roll_out(
            healthy, duration_s, needed_columns(monitored.sensors), None, 1.0,
            [(change_s, monitored.entry.build(later))],
        )  # fmt: skip
        seen = []
        for draw in range(STEP_DRAWS):
            random = np.random.default_rng(draw)
            vectors = monitored.vectors(seen_roll_out(run, monitored.sensors, healthy.coupling_step_s, random, begin_s))
            seen.append([surface.reduced(vector) for vector in vectors if vector.end_s > change_s])
        count = min(map(len, seen))
        y = np.array([[left.values for left, _ in each[:count]] for each in seen]).mean(axis=0)
        u = np.array([[point for _, point in each[:count]] for each in seen]).mean(axis=0)
        settled = y[-count // 3 :]
        noise = np.maximum(noise, settled.std(axis=0))
        runs.append((y - settled.mean(axis=0), u))
    return with_transients(surface, runs, noise) if runs else replace(surface)
