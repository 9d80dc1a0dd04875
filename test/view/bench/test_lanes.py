# SPDX-License-Identifier: Apache-2.0
"""Lanes tell every regime a machine was in, and the log only what is loud beside the hardest impact."""

from __future__ import annotations

import pytest
from catalogue import NAMES, built

from mech_twin.declarations.captions import caption
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import dynamics
from mech_twin.parameters.load import machine
from mech_twin.samples import Event
from mech_twin.view.bench.scene import TOOL, BenchScene, Lanes
from mech_twin.view.sending import LIVE

SPAN_S = 0.4


def words_over_time(told):
    """Return for each lane the words by time that a page makes of what pictures tell."""
    found: dict[str, list[tuple[float, str]]] = {}
    for picture in told:
        for lane, begin_s, word, changes in picture:
            for time_s, each in ((begin_s, word), *changes):
                row = found.setdefault(lane, [])
                if not row or row[-1][1] != each:
                    row.append((time_s, each))
    return found


def at(row, time_s):
    return [word for begin_s, word in row if begin_s <= time_s + 1e-9][-1]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("every", [1, 33])
def test_the_regime_of_each_step_is_in_its_lane_however_seldom_pictures_go_out(name, every):
    machine = built(name)
    lanes, told, steps = Lanes(machine), [], list(frames(machine, SPAN_S))
    for number, frame in enumerate(steps):
        lanes.add(frame)
        if number % every == 0:
            told.append(lanes.taken())
    found = words_over_time([*told, lanes.taken()])
    regimes = machine.linkage.regimes
    for frame in steps:
        time_s = frame.linkage.time_s
        assert at(found["supply"], time_s) == ("on" if frame.motor.command > 0.0 else "off")
        if machine.body is not None and frame.body is not None:
            assert at(found["body"], time_s) == machine.body.regimes[frame.body.regime].replace("_", " ")
        elif len(regimes) > 1:
            assert at(found["machine"], time_s) == regimes[frame.linkage.regime].replace("_", " ")


def test_a_page_that_has_lost_the_oldest_pictures_knows_the_regimes_from_the_next_one_on():
    machine = built("mb10_breaker")
    lanes, told = Lanes(machine), []
    for frame in frames(machine, SPAN_S):
        lanes.add(frame)
        if frame.linkage.step % 20 == 0:
            told.append(lanes.taken())
    whole, late = words_over_time(told), words_over_time(told[7:])
    begin_s = told[7][0][1]
    for lane, row in late.items():
        assert row[0] == (begin_s, at(whole[lane], begin_s))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({}, set()),
        ({"body.friction.coulomb_nm": 0.5}, {"body friction"}),
        ({"friction.coulomb_nm": 500.0}, {"crank friction"}),  # more than the motor can turn
    ],
)
def test_a_joint_has_a_lane_of_friction_where_friction_holds_it_or_acts_backwards(settings, told):
    rubbing = machine("mb10_breaker", None, settings)
    lanes = Lanes(rubbing)
    for frame in frames(rubbing, SPAN_S):
        lanes.add(frame)
    assert {name for name in words_over_time([lanes.taken()]) if name.endswith("friction")} == told


def test_the_words_of_the_tool_are_those_of_its_regimes():
    numbers = dynamics.STANDING, dynamics.MOVING, dynamics.PUSHED, dynamics.BLOCKED
    assert [TOOL[number] for number in numbers] == ["stands", "moves", "pushed", "blocked"]


class KeptLink:
    """A link that keeps what is told."""

    def __init__(self):
        self.told, self.pictures = [], []

    def tell(self, kind, content):
        self.told.append((kind, content))
        return True

    def show(self, picture):
        self.pictures.append(picture)
        return True

    def close(self):
        pass


def test_the_log_leaves_out_what_is_below_a_hundredth_of_the_hardest_impact():
    scene = BenchScene(KeptLink(), LIVE)
    for time_s, impulse_ns in ((0.1, 5.0), (0.2, 0.049), (0.3, 0.051), (0.4, 0.0)):
        scene.event(Event(time_s, "blow", "tool", -1.0, 0.5, impulse_ns, 1))
    assert [time_s for time_s, _ in scene._events] == [0.1, 0.3, 0.4]


def test_residuals_stand_beside_their_limits_the_nearest_first():
    machine, link = built("mb10_breaker"), KeptLink()
    scene = BenchScene(link, LIVE)
    scene.watch(machine)
    for frame in frames(machine, SPAN_S):
        scene.frame(frame)
    scene.close()
    rows = [content for kind, content in link.told if kind == "health"][-1]["residuals"]
    limits = {name for role in (machine.linkage, machine.forces, machine.body) for name in role.residual_limits}
    assert {name for name, *_ in rows} <= {", ".join(filter(None, caption(name))) for name in limits}
    shares = [float(worst) / float(limit) for _, worst, limit, _ in rows]
    assert shares == sorted(shares, reverse=True)
    assert not any(is_broken for *_, is_broken in rows)
