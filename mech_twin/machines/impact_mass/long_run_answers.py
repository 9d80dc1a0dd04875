# SPDX-License-Identifier: Apache-2.0
"""Answers of the impact mass to questions on its long run: synthesis of a cycle, map of its regimes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

from pydantic import TypeAdapter

from mech_twin.capabilities.long_run import CycleAnswer, RegimeAnswer, SynthesisAnswer
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.errors import StudyError
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.regimes import LongRunRegime, regime_of, write_bifurcation_picture
from mech_twin.machines.impact_mass.synthesis import CycleDesign, RobustnessSpec, cycle_spec, synthesise

USUAL_ROBUSTNESS = asdict(RobustnessSpec())
USUAL_KEY = "phase1_duration_s"
COLUMNS = ("regime", "period", "impacts per period", "hardest blow, m/s")
PHASES = ("period_s", "phase1_duration_s", "phase1_force_n", "phase2_force_n")
CHOSEN = (*PHASES, "initial_position_m", "initial_velocity_m_per_s")  # by a synthesis; all else is as configured


def synthesis_answer(
    parameters: ImpactMass, impact_speed_m_per_s: float, options: Mapping[str, float | int], periods: int
) -> SynthesisAnswer:
    """Return the published one-impact cycle and a robust one for the same asked cycle, side by side.

    Parameters
    ----------
    parameters : ImpactMass
        Mass, stop, start and restitution are taken from it, and all that a synthesis does not choose.
    impact_speed_m_per_s : float
        Wanted speed of the blow.
    options : mapping
        Fields of `RobustnessSpec` that differ from the usual ones.
    periods : int
        How long the endurance runs are.

    Raises
    ------
    StudyError
        If one of the cycles has no solution, naming the inequality that fails.
    """
    spec = cycle_spec(parameters, impact_speed_m_per_s)
    found = synthesise(spec, RobustnessSpec(**{**USUAL_ROBUSTNESS, **options}), periods)
    designs = tuple(_as_configured(parameters, design) for design in (found.published, found.robust))
    records = {design.name: cycle_record(design) for design in designs}
    cycles = tuple(
        CycleAnswer(design.name, design.parameters, records[design.name], cycle_lines(records[design.name]))
        for design in designs
    )
    asked = {"spec": asdict(found.spec), "robustness": asdict(found.robustness)}
    return SynthesisAnswer(asked, cycles, found.robust.name)


def _as_configured(parameters: ImpactMass, design: CycleDesign) -> CycleDesign:
    """Return a cycle in the given configuration; its coupling step is made shorter where the cycle asks for it."""
    chosen = {key: getattr(design.parameters, key) for key in CHOSEN}
    step_s = min(parameters.coupling.step_s, design.parameters.coupling.step_s)
    return replace(design, parameters=varied(parameters, {**chosen, "coupling.step_s": step_s}))


def regime_answer(
    parameters: ImpactMass,
    values: Sequence[float],
    key: str,
    settling_periods: int,
    progress: Callable[[int, int], None] | None = None,
) -> RegimeAnswer:
    """Return the long-run regimes over the values of one configuration key.

    Raises
    ------
    StudyError
        If a value of the key is no number.
    """
    found = []
    try:
        for value in values:
            found.append(regime_of(varied(parameters, {key: float(value)}), settling_periods))
            if progress is not None:
                progress(len(found), len(values))
    except TypeError as error:
        raise StudyError(str(error)) from error
    return _answer(key, tuple(float(value) for value in values), found)


def regimes_read(key: str, records: Sequence[Mapping[str, Any]]) -> RegimeAnswer:
    """Return regimes over the values of a key from the records of an answer."""
    rest = {key, "note"}
    regimes = [{name: value for name, value in record.items() if name not in rest} for record in records]
    values = tuple(record[key] for record in records)
    return _answer(key, values, TypeAdapter(list[LongRunRegime]).validate_python(regimes))


def _answer(key: str, values: tuple[float, ...], found: list[LongRunRegime]) -> RegimeAnswer:
    records = tuple(
        {key: value, **asdict(regime), "note": regime.note} for value, regime in zip(values, found, strict=True)
    )
    rows = tuple(
        (
            record[key],
            record["note"] or record["kind"],
            record["period"] or "-",
            " ".join("inf" if count < 0 else str(count) for count in record["impacts_per_period"]) or "-",
            max(record["blows_m_per_s"], default=0.0),
        )
        for record in records
    )
    draw = partial(write_bifurcation_picture, key, values, found)
    return RegimeAnswer(key, records, (key, *COLUMNS), rows, draw)


def cycle_record(design: CycleDesign) -> dict[str, Any]:
    """Return all that is known of a cycle as plain values."""
    known = asdict(design)
    del known["name"], known["parameters"]
    known["endurance"], judged = [*known["endurance"]], known["verdict"]
    pairs = ("multipliers", "other_side_multipliers")
    judged.update({name: judged[name] and [[m.real, m.imag] for m in judged[name]] for name in pairs})
    return {"config": configuration_tree(design.parameters), **known}


def certificate_lines(certificate: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of a certificate for people, by title."""
    c = certificate
    off = ", ".join(f"{name} {100.0 * value:+.2g} %" for name, value in c["worst_deviation"].items())
    return {
        "tolerance of P1, P2, t1, T, R": c["tolerance"],
        "points of the box tried (between them nothing is proved)": (
            f"{c['corners']} corners, {c['faces']} faces, {c['inside']} inside, {c['climbed']} climbed"
        ),
        "worst share that reaches it": c["worst_fraction"],
        "worst margin": c["worst_margin"],
        "slowest start, periods": c["slowest_periods"],
        "worst point": off,
    }


def cycle_lines(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of a cycle for people, by title."""
    p, judged, certificate = record["config"], record["verdict"], record["certificate"]
    lines: dict[str, Any] = {
        "T, s": p["period_s"],
        "t1, s": p["phase1_duration_s"],
        "P1, N": p["phase1_force_n"],
        "P2, N": p["phase2_force_n"],
        "start x0, m": p["initial_position_m"],
        "start v0, m/s": p["initial_velocity_m_per_s"],
        "stroke (largest gap), m": record["stroke_m"],
        "blow, m/s": record["impact_speed_m_per_s"],
        "verdict": judged["reason"],
        "margin 1 - |multiplier|": judged["margin"],
    }
    if (basin := judged["basin"]) is not None:
        box = basin["box"]
        lines["basin: share that reaches it"] = basin["fraction"]
        lines["basin: share that ends at rest"] = basin["at_rest"] / box["starts"]
        lines["basin: starts, seed"] = f"{box['starts']}, {box['seed']}"
    if certificate is not None:
        lines.update(certificate_lines(certificate))
    for name, lasting in zip(("T in full", "T to 4 decimals", "T cut to 3"), record["endurance"], strict=False):
        rest = f", at rest in period {lasting['rests_in_period']}" if lasting["rests_in_period"] else ""
        held = f"holds {lasting['held_periods']} of {lasting['periods']} periods"
        lines[name] = f"{lasting['period_s']:.7g} s: {held}{rest}"
    return lines
