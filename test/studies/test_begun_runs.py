# SPDX-License-Identifier: Apache-2.0
"""Numbers of a run that does not begin at step 0 of its samples: after a reset, and of a recording begun later."""

from __future__ import annotations

from pathlib import Path

import pytest
from catalogue import NAMES, PAGES, built

from mech_twin.engine.coupling import next_frame, restarted
from mech_twin.engine.run import complete_frame, frames
from mech_twin.parameters.load import machine as machine_of
from mech_twin.studies.simulation import ChangingObserver

ON_PAGES = tuple(path for path in PAGES if Path(path).stem in {"spring_hammer", "breaker", "rock_hammer"})
INSTANTS = ("time_s", "_at_s", "_from_s", "last_impact_time_s")  # of the time that goes on through a reset


def numbers(machine, run):
    observer = ChangingObserver(machine)
    for frame in run:
        observer.observe(frame)
    return observer.numbers()


def after_a_reset(machine, first_s, then_s):
    """Return the frames of a run that returns to its initial state."""
    run = list(frames(machine, first_s))
    run.append(complete_frame(machine, restarted(machine, run[-1].linkage.step + 1), run[-1].body, 1.0))
    for _ in range(round(then_s / machine.coupling_step_s)):
        run.append(next_frame(machine, run[-1], 1.0))
    return run


@pytest.mark.parametrize("name", [*NAMES, *ON_PAGES])
def test_after_a_reset_the_numbers_are_those_of_a_run_of_its_own(name):
    """Means would divide the work since the reset by all the time, and a turn would end that nobody observed."""
    machine = built(name)
    found = numbers(machine, after_a_reset(machine, 1.33, 1.0))
    alone = numbers(machine, frames(machine, 1.0))
    assert found.keys() == alone.keys()
    for key, value in alone.items():
        if not key.endswith(INSTANTS) and "residual" not in key:
            assert found[key] == pytest.approx(value, rel=1e-6, abs=1e-9), key


@pytest.mark.parametrize("name", [*NAMES, *ON_PAGES])
def test_after_a_gap_the_numbers_are_those_of_a_recording_begun_there(name):
    """Of a breaker's snapshot the blow rate was a fifth, and its first blow after the gap not seated."""
    machine = built(name)
    run = list(frames(machine, 2.0))
    late = [frame for frame in run if frame.linkage.time_s >= 1.2]
    early = [frame for frame in run if frame.linkage.time_s <= 0.8]
    assert numbers(machine, early + late) == pytest.approx(numbers(machine, late), rel=0, abs=0, nan_ok=True)
    assert numbers(machine, run[:-3] + run[-1:]) != numbers(machine, run[-1:])


def test_after_a_reset_a_page_settles_again():
    machine = machine_of(ON_PAGES[0], None, {"settle_s": 0.5})
    found = numbers(machine, after_a_reset(machine, 1.0, 1.0))
    alone = numbers(machine, frames(machine, 1.0))
    assert found == pytest.approx(alone, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", ON_PAGES)
def test_the_mean_power_of_a_page_recorded_from_later_on_is_that_of_the_time_recorded(name):
    """The works are those since the start of the run: they were divided by the time recorded."""
    machine = built(name)
    run = list(frames(machine, 2.0))
    late = [frame for frame in run if frame.linkage.time_s >= 1.5]
    (work,) = {f"{drive}_work_j" for drive in machine.parameters.drives}
    done = late[-1].linkage.memory[work] - late[0].linkage.memory[work]
    span = late[-1].linkage.time_s - late[0].linkage.time_s
    assert numbers(machine, late)["run_power_mean_w"] == pytest.approx(done / span, rel=1e-9)


def test_means_of_the_impact_mass_recorded_from_later_on_are_those_of_the_time_recorded():
    machine = built("impact_mass")
    run = list(frames(machine, 2.0))
    late = [frame for frame in run if frame.linkage.time_s >= 1.5]
    found, blows = numbers(machine, late), [e for f in late[1:] for e in f.linkage.events if e.kind == "impact"]
    assert found["impacts"] == len(blows) > 10
    span = late[-1].linkage.time_s - late[0].linkage.time_s
    impulse = sum(frame.forces.quantities["stop_impulse_ns"] for frame in late[1:])
    assert found["mean_stop_force_n"] == pytest.approx(impulse / span, rel=1e-9)
    assert found["mean_blow_m_per_s"] == pytest.approx(sum(e.pre_velocity_m_per_s for e in blows) / len(blows))
    assert found["energy_unbalanced_j"] == pytest.approx(0.0, abs=1e-9)
