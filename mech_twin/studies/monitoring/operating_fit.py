# SPDX-License-Identifier: Apache-2.0
"""Fits the operating surface of a machine by simulation: measurable variables, their effects, and transients."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import islice, product

import numpy as np
from pydantic import ValidationError
from scipy.linalg import qr
from scipy.stats import qmc

from mech_twin.capabilities.cycle import TURN, Array
from mech_twin.capabilities.faults import OperatingVariable
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.errors import MotionError
from mech_twin.studies.monitoring.baseline import feature_runs, regularised
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.diagnosis import MODEL_SHARE, USED_CYCLES
from mech_twin.studies.monitoring.operating import (
    LIMIT,
    MOVES,
    SMOOTHED,
    OperatingSurface,
    SurfaceVariable,
    chosen_variables,
    polynomial_terms,
    term_values,
)
from mech_twin.studies.monitoring.sensing import (
    MonitoredMachine,
    mean_period_s,
    needed_columns,
    noisy_draws,
    seen_roll_out,
    steady_cycles,
)

POINTS_A_TERM = 3
LEAST_MOVED = 0.05  # of a range: lower bound of a step, for a cycle near whose end a variable steps
PASSES, NEAR = 3, 0.05  # of a range: a baseline is so near the point about which effects are computed
SETTLED_CYCLES = 25  # simulated before the cycles that are averaged
STEP = 1.0  # of a range, to measure the transient: down at the even phases, up at the odd ones
STEP_DRAWS, STEP_PHASES = 2, 8
FIRST_PHASE = 0.25  # of the distance between phases: no harmonic up to the fourth is zero at each of them
KNOT_S = 1.0  # between the operating points of a drift
DRIFT_S = 600.0  # shortest period in which a variable moves through its range and back


def operating_surface(
    monitored: MonitoredMachine,
    vectors: Sequence[FeatureVector],
    names: tuple[str, ...],
    passes: int = PASSES,
) -> OperatingSurface | None:
    """Return the operating surface for these features; None if no declared variable has a measurable effect.

    A baseline that differs from the configuration as one at another operating point does is taken for that, and effects
    are computed about its point, again in so many ``passes`` at most.
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

    surface = _fitted_surface(groups, rolled_out, names, rows, root, unexplained)
    configured, own = replace(surface, mean=reference), rows.mean(axis=0)
    point = configured.located(own)
    if passes and np.abs(point).max() > NEAR and configured.open_share(own) <= MODEL_SHARE**2:
        parameters = parameters_at(monitored.parameters, chosen, point * surface.ranges)
        if parameters is not None:
            return operating_surface(replace(monitored, parameters=parameters), vectors, names, passes - 1)
    return _drifting(monitored, _settling(monitored, surface, chosen, duration_s), usable, duration_s)


def sister_surface(surface: OperatingSurface, vectors: Sequence[FeatureVector]) -> OperatingSurface:
    """Return the surface centred on the healthy cycles of another machine of the same configuration and sensors."""
    rows, root = _rows(vectors, surface.names), _root_of_noise(vectors, surface.names)
    return replace(surface, root=root).centred(rows)


def left_by_point(
    surface: OperatingSurface, vectors: Sequence[FeatureVector]
) -> tuple[OperatingSurface, list[FeatureVector]]:
    """Return the surface with the wander of a baseline, and the residual features y of each cycle."""
    reduced = [surface.reduced(vector) for vector in vectors]
    points = [left._replace(names=surface.variables, values=point) for left, point in reduced]
    return _with_baseline(surface, feature_runs(points, surface.variables)), [left for left, _ in reduced]


def parameters_at(
    parameters: Parameters, variables: Iterable[OperatingVariable], shares: Iterable[float]
) -> Parameters | None:
    """Return the configuration at an operating point; None if validation rejects it."""
    try:
        for variable, share in zip(variables, shares, strict=True):
            parameters = varied(parameters, variable.changes(parameters, float(share)))
    except ValidationError:
        return None
    return parameters


def operated_run(
    monitored: MonitoredMachine,
    variables: Sequence[OperatingVariable],
    at_s: Array,
    shares: Array,
    command: Array,
) -> RollOut:
    """Return a simulation through operating points: shares (n, q) of the healthy values from the instants (n,) on.

    Parameters
    ----------
    variables : sequence of OperatingVariable
        The q variables that change.
    at_s, shares : ndarray
        Shapes (n,) and (n, q): start of each operating point (s), and its shares.
    command : ndarray
        One value for each step, see `roll_out`.

    Raises
    ------
    MotionError
        If the machine cannot run at this point.
    """
    step_s, base = monitored.entry.build(monitored.parameters).coupling_step_s, monitored.parameters
    for variable, share in zip(variables, shares.T, strict=True):
        if variable.is_commanded:  # interpolated: a step at every knot would be too high an acceleration
            command = command * (1.0 + np.interp(step_s * np.arange(len(command)), at_s, share))
            most = float(command.max())  # the command cannot exceed the configured value
            base, command = varied(base, variable.changes(base, most - 1.0)), command / most
    built = [k for k, variable in enumerate(variables) if not variable.is_commanded]
    machines = []
    for instant, point in zip(at_s if built else at_s[:1], shares[:, built], strict=False):
        parameters = parameters_at(base, [variables[k] for k in built], point)
        if parameters is None:
            raise MotionError(f"operating point {point}: refused")
        machines.append((float(instant), monitored.entry.build(parameters)))
    duration_s = (len(command) - 1) * step_s
    run = roll_out(machines[0][1], duration_s, needed_columns(monitored.sensors), None, command, machines[1:])
    if run.error is not None:
        raise run.error
    return run


def _drifting(
    monitored: MonitoredMachine, surface: OperatingSurface, variables: Sequence[OperatingVariable], duration_s: float
) -> OperatingSurface:
    """Return the surface with the error of y during a drift of each variable, beyond that of steady points."""
    step_s, begin_s = monitored.entry.build(monitored.parameters).coupling_step_s, monitored.declared.run_up_s
    at_s = np.arange(0.0, duration_s, KNOT_S)
    middle_s = duration_s - 0.5 * USED_CYCLES * mean_period_s(monitored)

    def left(shares: Array) -> Array:
        run = operated_run(monitored, variables, at_s, shares, np.ones(round(duration_s / step_s) + 1))
        rows = []
        for draw in range(STEP_DRAWS):
            random = np.random.default_rng(draw)
            vectors = monitored.vectors(seen_roll_out(run, monitored.sensors, step_s, random, begin_s), USED_CYCLES)
            rows += [surface.reduced(vector)[0].values for vector in vectors]
        judged = [row for row in rows if np.isfinite(row).all()]
        return np.mean(judged, axis=0) if judged else np.zeros(len(surface.others))

    none = np.zeros((len(at_s), len(variables)))
    still, drift = left(none), np.zeros(len(surface.others))
    for k, variable in enumerate(variables):
        shares = none.copy()
        shares[:, k] = variable.range * TURN / DRIFT_S * (at_s - middle_s)
        try:
            drift = np.hypot(drift, left(shares) - still)
        except MotionError:  # no steady running at this point, so there is no estimate of the drift
            continue
    return replace(surface, drift=drift)


def _features_at(
    monitored: MonitoredMachine, parameters: Parameters | None, duration_s: float, names: tuple[str, ...]
) -> Array | None:
    """Return the mean features in steady running; None if the machine does not run with these parameters."""
    if parameters is None:
        return None
    try:
        found = steady_cycles(monitored, noisy_draws(monitored, parameters, duration_s), names)
    except MotionError:
        return None
    return None if found is None else found.mean


def _rows(vectors: Sequence[FeatureVector], names: tuple[str, ...]) -> Array:
    rows = np.array([vector.row(names) for vector in vectors])
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])


def _root_of_noise(vectors: Sequence[FeatureVector], names: tuple[str, ...]) -> Array:
    """Return L^-1, with L L' half the covariance of the differences between neighbouring cycles."""
    steps = np.concatenate([np.diff(run, axis=0) for run in feature_runs(vectors, names)])
    found = regularised(0.5 * steps.T @ steps / max(len(steps) - 1, 1), _rows(vectors, names).mean(axis=0))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(found)))


def _settling(
    monitored: MonitoredMachine, surface: OperatingSurface, chosen: Sequence[OperatingVariable], duration_s: float
) -> OperatingSurface:
    """Return the surface with its transients, from simulations with a step of each variable at several phases."""
    begin_s, healthy = monitored.declared.run_up_s, monitored.entry.build(monitored.parameters)
    first_s, period_s = begin_s + 0.3 * (duration_s - begin_s), mean_period_s(monitored)
    runs: list[list[tuple[Array, Array]]] = [[] for _ in chosen]
    noise = surface.left_noise / STEP_DRAWS**0.5  # sensors without a known sigma have none in these runs
    for k, phase in product(range(len(chosen)), range(STEP_PHASES)):
        later = parameters_at(monitored.parameters, [chosen[k]], [STEP * (-1) ** phase * float(surface.ranges[k])])
        if later is None:
            continue
        change_s = first_s + (phase + FIRST_PHASE) / STEP_PHASES * period_s
        run = roll_out(
            healthy, duration_s, needed_columns(monitored.sensors), None, 1.0,
            [(change_s, monitored.entry.build(later))],
        )  # fmt: skip
        seen: list[list[tuple[FeatureVector, Array]]] = []
        before: list[Array] = []
        for draw in range(STEP_DRAWS):
            random = np.random.default_rng((k, phase, draw))  # the same noise would look like a transient
            vectors = monitored.vectors(seen_roll_out(run, monitored.sensors, healthy.coupling_step_s, random, begin_s))
            sooner = (surface.reduced(vector)[1] for vector in reversed(vectors) if vector.end_s <= change_s)
            before += islice((point for point in sooner if np.isfinite(point).all()), 1)
            seen.append([surface.reduced(vector) for vector in vectors if vector.end_s > change_s])
        count = min(map(len, seen))
        if not count:
            continue
        y = np.array([[left.values for left, _ in each[:count]] for each in seen]).mean(axis=0)
        u = np.array([[point for _, point in each[:count]] for each in seen]).mean(axis=0)
        is_judged = np.isfinite(y).all(axis=1) & np.isfinite(u).all(axis=1)
        y, u = y[is_judged], u[is_judged]
        if not len(y):
            continue
        settled = y[-count // 3 :]
        noise = np.maximum(noise, settled.std(axis=0))
        runs[k].append((y - settled.mean(axis=0), u - (before[-1] if before else u[0])))
    return _with_transients(surface, runs, noise)


def _fitted_surface(
    groups: Sequence[SurfaceVariable],
    rolled_out: Callable[[Array], Array | None],
    names: tuple[str, ...],
    rows: Array,
    root: Array,
    unexplained: Array,
) -> OperatingSurface:
    """Return the surface fitted to simulations at points of the ranges, centred on the baseline's cycles.

    Parameters
    ----------
    rolled_out : callable
        Change of the features (d,) at shares (q,) of the healthy values; None where the simulation fails.
    rows : ndarray
        Shape (n, d): features of healthy cycles.
    root : ndarray
        See `OperatingSurface`.
    unexplained : ndarray
        Shape (d,): error due to the variables that were left out.
    """
    q, ranges = len(groups), np.array([group.range for group in groups])
    terms = polynomial_terms(q)
    count = POINTS_A_TERM * len(terms)
    places = LIMIT * (2.0 * qmc.Sobol(q, seed=1).random(1 << (count - 1).bit_length())[:count] - 1.0)
    places = np.concatenate([places, LIMIT * np.eye(q), -LIMIT * np.eye(q)])
    found = [(u, response) for u in places if (response := rolled_out(u * ranges)) is not None]
    points, responses = (np.array(each) for each in zip(*found, strict=True))
    design = np.array([term_values(terms, u)[0] for u in points])
    coefficients = np.linalg.lstsq(design, responses, rcond=None)[0]
    leverage = np.clip(np.einsum("ij,ji->i", design, np.linalg.pinv(design)), 0.0, 0.9)
    held_out = (responses - design @ coefficients) / (1.0 - leverage)[:, None]
    slope = coefficients[:q].T
    pivots = tuple(int(i) for i in qr((root.diagonal()[:, None] * slope).T, pivoting=True, mode="r")[1][:q])
    nothing, nothing_left = np.zeros(q), np.zeros(len(names) - q)
    blank = OperatingSurface(
        names, tuple(g.name for g in groups), tuple(g.beyond for g in groups), pivots, ranges, rows.mean(axis=0), root,
        coefficients, nothing_left, nothing, nothing, np.zeros((q, len(names) - q)), 1, nothing_left,
    )  # fmt: skip
    blank = blank.centred(rows)
    off = np.array([blank.annihilator(u) @ left for u, left in zip(np.clip(points, -1, 1), held_out, strict=True)])
    doubt = np.sqrt((off**2).mean(axis=0)) + np.abs(blank.annihilator(nothing) @ unexplained)
    return replace(blank, doubt=doubt)


def _with_transients(
    surface: OperatingSurface, runs: Sequence[Sequence[tuple[Array, Array]]], noise: Array
) -> OperatingSurface:
    """Return the surface with the transients of y during a movement, from runs with a step of one variable.

    Parameters
    ----------
    runs : sequence of sequences of (ndarray, ndarray)
        For each variable, stepped at several phases of a cycle: y (n, d - q) minus its settled mean from the step on,
        and the change of u (n, q) since.
    noise : ndarray
        Shape (d - q,): standard deviation of y in these runs.
    """
    transient, hold = np.zeros((len(surface.variables), len(surface.others))), 2
    for k, each in enumerate(runs):
        lasting: list[int] = []
        for y, u in each:
            over = np.maximum(np.abs(y) - 4.0 * noise, 0.0)
            lasting += np.flatnonzero(over.any(axis=1)).tolist()
            spans = np.maximum.accumulate(np.maximum(u[:, k], 0.0)) - np.minimum.accumulate(np.minimum(u[:, k], 0.0))
            ratios = over / np.maximum(spans, LEAST_MOVED)[:, None]
            transient[k] = np.maximum(transient[k], MOVES * ratios.max(axis=0))
        hold = max([hold, *(cycle + 2 for cycle in lasting if lasting.count(cycle) > 1)])  # seen once it is noise
    return replace(surface, transient=transient, hold=hold)


def _with_baseline(surface: OperatingSurface, runs: Sequence[Array]) -> OperatingSurface:
    """Return the surface with the wander and movement of the baseline's points, (n, q) for each run."""
    moved, smooth = np.zeros(len(surface.variables)), []
    for u in runs:
        for first in range(len(u)):
            moved = np.maximum(moved, np.ptp(u[first : first + surface.hold], axis=0))
        kept = u[0]
        for i, each in enumerate(u):
            kept = kept + max(1.0 / (i + 1.0), SMOOTHED) * (each - kept)
            smooth.append(kept)
    scatter = np.concatenate(runs).std(axis=0) * (SMOOTHED / (2.0 - SMOOTHED)) ** 0.5
    return replace(surface, moved=moved, wander=np.maximum(np.std(smooth, axis=0), scatter))
