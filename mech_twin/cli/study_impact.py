"""Answers of ``mech-twin study impact_mass synthesise`` and ``regimes``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.study_options import axes_of, counted, require_machine, study_errors
from mech_twin.configuration_tree import configuration_tree
from mech_twin.dependencies import require_extra
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.regimes import write_bifurcation_picture
from mech_twin.machines.impact_mass.synthesis import CycleDesign, RobustnessSpec
from mech_twin.machines.impact_mass.tolerance_box import Certificate
from mech_twin.parameters.load import assignments, machine_parameters, write_configuration
from mech_twin.studies import regimes, synthesise

MACHINE = "impact_mass"


@dataclass(frozen=True)
class SynthesisRequest:
    """What cycle is wanted, as it stands on the command line."""

    impact_speed_m_per_s: float
    margin: float
    basin_fraction: float
    tolerance: float
    stroke_ratio: float
    starts: int
    seed: int
    periods: int
    out: Path


def _parameters(config: Path | None, settings: list[str]) -> ImpactMass:
    parameters = machine_parameters(MACHINE, config, assignments(settings))
    assert isinstance(parameters, ImpactMass)
    return parameters


def answer_synthesise(
    machine: str, request: SynthesisRequest, config: Path | None, settings: list[str], *, as_json: bool
) -> None:
    """Show both cycles side by side; write the robust one's configuration."""
    require_machine(machine, MACHINE, "synthesise")
    r = request
    robustness = RobustnessSpec(
        margin=r.margin,
        basin_fraction=r.basin_fraction,
        tolerance=r.tolerance,
        stroke_ratio=r.stroke_ratio,
        starts=r.starts,
        seed=r.seed,
    )
    parameters = _parameters(config, settings)
    with study_errors():
        try:
            found = synthesise(parameters, r.impact_speed_m_per_s, robustness=robustness, periods=r.periods)
        except ValueError as error:
            raise CommandError(str(error)) from error
        write_configuration("impact_mass", found.robust.parameters, r.out)
    if as_json:
        cycles = {design.name: _record(design) for design in (found.published, found.robust)}
        document = {"machine": MACHINE, "spec": asdict(found.spec), "robustness": asdict(found.robustness), **cycles}
        print_json({**document, "configuration": str(r.out)})
        return
    both = [_lines(design) for design in (found.published, found.robust)]
    rows = [(name, *(lines.get(name, "-") for lines in both)) for name in dict.fromkeys([*both[0], *both[1]])]
    print_table("one-impact cycle", ("", "published", "robust"), rows)
    say(f"wrote {r.out}")


def _record(design: CycleDesign) -> dict[str, Any]:
    judged = asdict(design.verdict)
    pairs = ("multipliers", "other_side_multipliers")
    judged.update({name: judged[name] and [[m.real, m.imag] for m in judged[name]] for name in pairs})
    return {
        "config": configuration_tree(design.parameters),
        "impact_speed_m_per_s": design.impact_speed_m_per_s,
        "impact_tau_s": design.impact_tau_s,
        "stroke_m": design.stroke_m,
        "verdict": judged,
        "endurance": [asdict(lasting) for lasting in design.endurance],
        "certificate": design.certificate and _certificate_record(design.certificate),
    }


def _certificate_record(certificate: Certificate) -> dict[str, Any]:
    return {
        **asdict(certificate),
        "tried": certificate.tried,
        "worst_deviation": certificate.worst_deviation._asdict(),
    }


def _certificate_lines(certificate: Certificate) -> dict[str, Any]:
    c = certificate
    off = ", ".join(f"{name} {100.0 * value:+.2g} %" for name, value in c.worst_deviation._asdict().items())
    return {
        "tolerance of P1, P2, t1, T, R": c.tolerance,
        "points of the box tried": f"{c.corners} corners, {c.faces} faces, {c.inside} inside, {c.climbed} climbed",
        "worst share that reaches it": c.worst_fraction,
        "worst margin": c.worst_margin,
        "slowest start, periods": c.slowest_periods,
        "worst point": off,
    }


def _lines(design: CycleDesign) -> dict[str, Any]:
    p, judged = design.parameters, design.verdict
    lines: dict[str, Any] = {
        "T, s": p.period_s,
        "t1, s": p.phase1_duration_s,
        "P1, N": p.phase1_force_n,
        "P2, N": p.phase2_force_n,
        "start x0, m": p.initial_position_m,
        "start v0, m/s": p.initial_velocity_m_per_s,
        "stroke (largest gap), m": design.stroke_m,
        "blow, m/s": design.impact_speed_m_per_s,
        "verdict": judged.reason,
        "margin 1 - |multiplier|": judged.margin,
    }
    if judged.basin is not None:
        lines["basin: share that reaches it"] = judged.basin.fraction
        lines["basin: share that ends at rest"] = judged.basin.at_rest / judged.basin.box.starts
        lines["basin: starts, seed"] = f"{judged.basin.box.starts}, {judged.basin.box.seed}"
    if design.certificate is not None:
        lines.update(_certificate_lines(design.certificate))
    for name, lasting in zip(("T in full", "T to 4 decimals", "T cut to 3"), design.endurance, strict=False):
        rest = f", at rest in period {lasting.rests_in_period}" if lasting.rests_in_period else ""
        lines[name] = f"{lasting.period_s:.7g} s: holds {lasting.held_periods} of {lasting.periods} periods{rest}"
    return lines


def answer_regimes(
    machine: str,
    over: list[str],
    settling: int,
    out: Path,
    config: Path | None,
    settings: list[str],
    *,
    as_json: bool,
) -> None:
    """Show the regime at each value; write the bifurcation picture."""
    require_machine(machine, MACHINE, "regimes")
    require_extra("plots")
    axes = axes_of(over)
    if len(axes) != 1:
        raise CommandError("--over: a regime map has one key")
    ((key, values),) = axes.items()
    parameters = _parameters(config, settings)
    with study_errors(), counted("regimes") as progress:
        try:
            found = regimes(parameters, values, key, settling_periods=settling, progress=progress)
        except TypeError as error:
            raise CommandError(f"--over {over[0]}: {error}") from error
        write_bifurcation_picture(found, out)
    rows = [
        {key: value, **asdict(regime), "note": regime.note}
        for value, regime in zip(found.values, found.regimes, strict=True)
    ]
    if as_json:
        print_json({"machine": MACHINE, "key": key, "regimes": rows, "picture": str(out)})
        return
    shown = [
        (
            row[key],
            row["note"] or row["kind"],
            row["period"] or "-",
            " ".join("inf" if count < 0 else str(count) for count in row["impacts_per_period"]) or "-",
            max(row["blows_m_per_s"], default=0.0),
        )
        for row in rows
    ]
    print_table("regimes", (key, "regime", "period", "impacts per period", "hardest blow, m/s"), shown)
    say(f"wrote {out}")
