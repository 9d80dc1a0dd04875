# SPDX-License-Identifier: Apache-2.0
"""Impact mass: a mass under a two-level periodic force, striking a stop; exact events, no time step."""

from functools import partial

from mech_twin.capabilities.blow_gauge import blow_remarks
from mech_twin.engine.compiled_roles import StepForces
from mech_twin.machines.catalog import usual_capabilities
from mech_twin.machines.impact_mass.drawing import mass_drawing, mechanism
from mech_twin.machines.impact_mass.forces import Stop, force_layout
from mech_twin.machines.impact_mass.metrics import cycle_metrics, position_metrics
from mech_twin.machines.impact_mass.observer import MassObserver
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.roles import Generator, MassOnStop, force_generator
from mech_twin.machines.impact_mass.step import StoppedMass
from mech_twin.machines.impact_mass.wave_stop import blow_numbers, stop_gauge, unit_blow
from mech_twin.parts.rod_waves.parameters import rounded_lengths
from mech_twin.roles import Capabilities, Machine, no_remarks

PARAMETERS = ImpactMass


def build(p: ImpactMass) -> Machine:
    """Return the impact mass of these parameters."""
    step_s, stiffness = p.coupling.step_s, p.contact_stiffness_n_per_m
    forces_n = p.phase1_force_n, p.phase2_force_n
    resting = p.system._replace(acceleration1=0.0, acceleration2=0.0)
    linkage = MassOnStop(
        StoppedMass(resting, p.mass_kg, p.stop_position_m, step_s),
        step_s,
        forces_n,
        p.supply.initial_fraction,
        p.initial_position_m,
        p.initial_velocity_m_per_s,
    )
    waves, stiff = p.stop.model == "wave", stiffness is not None
    unit = unit_blow(p.stop.wave, p.mass_kg) if waves else None
    contact = (0.0, 0.0) if unit is None else (unit.peak_force_n, unit.contact_time_s)
    stop = Stop(p.period_s, p.phase1_duration_s, step_s, stiff, stiffness or 0.0, waves, *contact)
    return Machine(
        "impact_mass",
        p,
        step_s,
        force_generator(Generator(*forces_n, p.supply.rate_per_s, step_s)),
        linkage,
        StepForces(stop, force_layout(stiff or waves), ("mass",), {}),
        None,
        lambda sample, _: mass_drawing(p.stop_position_m, sample),
        partial(cycle_metrics, p),
        partial(position_metrics, p),
        lambda: MassObserver(p.stop_position_m, partial(blow_numbers, p.stop.wave, p.mass_kg) if waves else None),
        mechanism(p.stop_position_m, p.mass_kg),
        rests_when_supplied=True,
        gauge=stop_gauge(p.stop.wave, p.mass_kg) if waves else None,
        remarks=partial(blow_remarks, rounded_lengths(p.stop.wave, "stop.wave")) if waves else no_remarks,
    )


def capabilities() -> Capabilities:
    """Return the machine's capabilities beyond running."""
    from mech_twin.capabilities.long_run import RegimeQuestion, SynthesisQuestion
    from mech_twin.machines.impact_mass import long_run_answers, metrics, published

    asked = long_run_answers
    synthesis = SynthesisQuestion(asked.USUAL_ROBUSTNESS, asked.synthesis_answer, asked.cycle_lines)
    regimes = RegimeQuestion(asked.USUAL_KEY, asked.regime_answer, asked.regimes_read)
    motion = metrics.ANCHORED_MOTION
    return usual_capabilities(metrics, published, synthesis=synthesis, regimes=regimes, anchored_motion=motion)
