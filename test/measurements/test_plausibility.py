# SPDX-License-Identifier: Apache-2.0
"""A run that is none of this machine is said to be so, in one line; one that is passes in silence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from catalogue import PAGES, built
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.engine.run import frames
from mech_twin.errors import MeasurementError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.measurements.blocks import NO_DELAYS, Array, Block, SourceColumn
from mech_twin.measurements.measurement_map import Channel, MeasurementMap, TimeSource
from mech_twin.measurements.model_turn import TURN, ModelTurn, following, model_turn
from mech_twin.measurements.plausibility import implausible
from mech_twin.measurements.quality import QualityGauge
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun, read_run, require_usable
from mech_twin.measurements.tables import TableReader
from mech_twin.measurements.units import UNITS as UNITS_OF_MAPS
from mech_twin.measurements.units import machine_columns

MACHINE = "roller_former"  # its two carts can be swapped
COLUMNS = tuple(
    f"linkage.{joint}" for joint in ("crank.position", "cart_1.position", "cart_2.position", "crank.velocity")
)
UNITS = machine_columns(built(MACHINE))


@pytest.fixture(scope="module")
def turn() -> ModelTurn:
    found = model_turn(built(MACHINE))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def motion() -> dict[str, Array]:
    rows = [frame.linkage for frame in frames(built(MACHINE), 5.0)][::5]
    joints = built(MACHINE).linkage.joints
    found = {f"linkage.{j}.position": np.array([row.position[i] for row in rows]) for i, j in enumerate(joints)}
    found |= {f"linkage.{j}.velocity": np.array([row.velocity[i] for row in rows]) for i, j in enumerate(joints)}
    return {"time_s": np.array([row.time_s for row in rows]), **found}


def measured(motion: dict[str, Array], *names: str, **keys: Any) -> MeasuredRun:
    """Return a run whose channels show the columns, perfectly."""
    found = []
    for name in names:
        channel = Channel.model_validate({"source": {"column": name}, "is": name, **keys})
        gauge = QualityGauge()
        gauge.add(Block(0, motion["time_s"], motion[name], NO_DELAYS))
        found.append(MeasuredChannel(channel, motion["time_s"], motion[name], gauge.quality()))
    return MeasuredRun(Path("run"), tuple(found))


def with_values(run: MeasuredRun, name: str, change: Callable[[Array], Array]) -> MeasuredRun:
    return replace(
        run, channels=tuple(replace(c, values=change(c.values)) if c.name == name else c for c in run.channels)
    )


def renamed(run: MeasuredRun, names: dict[str, str]) -> MeasuredRun:
    return replace(
        run,
        channels=tuple(
            replace(c, channel=c.channel.model_copy(update={"quantity": names.get(c.name, c.name)}))
            for c in run.channels
        ),
    )


def the_line(found: list[str], *words: str) -> None:
    assert len(found) == 1
    assert "\n" not in found[0]
    for word in words:
        assert word in found[0]


@pytest.mark.parametrize("name", [*CATALOGUE, *PAGES])
def test_a_run_of_the_machine_itself_passes(name: str) -> None:
    machine = built(name)
    rows = [frame.linkage for frame in frames(machine, 6.0)]
    own = {"time_s": np.array([row.time_s for row in rows])}
    for i, joint in enumerate(machine.linkage.joints):
        own[f"linkage.{joint}.position"] = np.unwrap([row.position[i] for row in rows])
    moving = [column for column in own if column != "time_s" and np.ptp(own[column]) > 0.0]
    assert implausible(measured(own, *moving), model_turn(machine), machine_columns(machine)) == []


def test_the_driven_joint_of_a_page_is_its_crank_whatever_its_name() -> None:
    machine = built(next(path for path in PAGES if path.endswith("slider_crank.yaml")))
    crank, ram = "linkage.crank_bearing.position", "linkage.guide.position"
    rows = [frame.linkage for frame in frames(machine, 3.0)]
    own = {"time_s": np.array([row.time_s for row in rows])}
    for name in (crank, ram):
        place = machine.linkage.joints.index(name.split(".")[1])
        own[name] = np.array([row.position[place] for row in rows])
    good, turn, units = measured(own, crank, ram), model_turn(machine), machine_columns(machine)
    assert implausible(good, turn, units) == []
    the_line(implausible(with_values(good, ram, lambda x: 1e3 * x), turn, units), ram, "is its unit mm?")
    the_line(implausible(with_values(good, ram, np.negative), turn, units), ram, "is a sign of the map wrong?")
    assert any("expected unit deg?" in line for line in implausible(with_values(good, crank, np.degrees), turn, units))


@pytest.mark.parametrize("turned_rad", [0.5, TURN, 31.4])
def test_a_motion_that_either_sense_of_the_crank_explains_without_noise_keeps_its_sign(turned_rad: float) -> None:
    found = model_turn(built("vibration_crank"))
    assert found is not None
    for count in range(500, 520):  # whose rounding differs
        crank = np.linspace(0.0, turned_rad, count)
        rod = found.at("linkage.rod.position", crank)
        for zero in (None, 0.0):
            told = following(found, "linkage.rod.position", crank, rod, zero)
            assert (told.sign, told.crank_sign) == (1, 1)


def test_a_wrong_unit_is_named_with_the_right_one(motion: dict[str, Array], turn: ModelTurn) -> None:
    good = measured(motion, *COLUMNS)
    the_line(
        implausible(with_values(good, COLUMNS[1], lambda x: 1e3 * x), turn, UNITS), COLUMNS[1], "1e+03 times", "mm"
    )
    the_line(implausible(with_values(good, COLUMNS[3], lambda x: x * 60.0 / TURN), turn, UNITS), COLUMNS[3], "rpm")
    in_degrees = with_values(with_values(good, COLUMNS[0], np.degrees), COLUMNS[3], np.degrees)
    assert any("expected unit deg?" in line for line in implausible(in_degrees, turn, UNITS))


def test_an_angle_in_degrees_that_starts_anew_at_each_turn_is_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    wrapped = with_values(measured(motion, COLUMNS[0]), COLUMNS[0], lambda x: np.mod(np.degrees(x), 360.0))
    the_line(implausible(wrapped, turn, UNITS), COLUMNS[0], "expected unit deg?")


def test_the_unit_of_what_slides_is_a_length_whatever_its_name() -> None:
    machine, ram = built("vibration_crank"), "linkage.slider.position"
    rows = [frame.linkage for frame in frames(machine, 3.0)]
    own = {"time_s": np.array([row.time_s for row in rows])}
    for name in ("linkage.crank.position", ram):
        place = machine.linkage.joints.index(name.split(".")[1])
        own[name] = np.unwrap([row.position[place] for row in rows])
    in_millimetres = with_values(measured(own, *list(own)[1:]), ram, lambda x: 1e3 * x)
    the_line(implausible(in_millimetres, model_turn(machine), machine_columns(machine)), ram, "is its unit mm?")


def test_swapped_channels_are_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    swapped = renamed(measured(motion, *COLUMNS[:3]), {COLUMNS[1]: COLUMNS[2], COLUMNS[2]: COLUMNS[1]})
    found = implausible(swapped, turn, UNITS)
    assert any("swapped" in line for line in found), found


def test_a_run_of_another_machine_is_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    other = with_values(
        measured(motion, *COLUMNS[:2]), COLUMNS[1], lambda x: np.cos(7.3 * motion["time_s"]) * np.ptp(x) / 2
    )
    the_line(implausible(other, turn, UNITS), COLUMNS[1], "does not follow", "another machine")


def test_an_unknown_zero_of_the_crank_is_named_and_not_another_machine(
    motion: dict[str, Array], turn: ModelTurn
) -> None:
    mounted = with_values(measured(motion, *COLUMNS[:2]), COLUMNS[0], lambda x: x + 1.6)
    the_line(implausible(mounted, turn, UNITS), COLUMNS[1], "does not follow", f"another zero of {COLUMNS[0]}")


@pytest.mark.parametrize("before", [1, 40])
def test_a_few_stamps_of_another_clock_are_no_wrong_unit_of_the_time(
    before: int, motion: dict[str, Array], turn: ModelTurn
) -> None:
    crank = measured(motion, COLUMNS[0]).channels[0]
    since_1970 = np.concatenate([crank.times_s[:before], crank.times_s[before:] + 1.7e9])
    run = MeasuredRun(Path("run"), (replace(crank, times_s=since_1970),))
    the_line(implausible(run, turn, UNITS), COLUMNS[0], "gap of 1.7e+09 s", "Cut the run there")


def test_a_position_of_the_wrong_sign_is_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    columns = ("linkage.crank.position", "linkage.rod_1.position", "linkage.cart_1.position")
    turned = with_values(measured(motion, *columns), columns[2], np.negative)
    the_line(implausible(turned, turn, UNITS), columns[2], "sign", "turned round")


def test_a_crank_that_turns_against_the_model_is_named_with_the_sign_expected(
    motion: dict[str, Array], turn: ModelTurn
) -> None:
    turned = with_values(measured(motion, COLUMNS[0]), COLUMNS[0], np.negative)
    the_line(implausible(turned, turn, UNITS), COLUMNS[0], "turns at -", "expected sign -1")


def with_clock(run: MeasuredRun, change: Callable[[Array], Array], *, turns: bool) -> MeasuredRun:
    """Return the run under another clock, read from a table; angles within one turn unless turns are counted."""
    rows = {c.name: c.values if turns or c.name != COLUMNS[0] else np.mod(c.values, TURN) for c in run.channels}
    blocks = [Block(i, change(run.channels[0].times_s), values, NO_DELAYS) for i, values in enumerate(rows.values())]
    return read_run(FewBlocks(blocks), MeasurementMap(machine=MACHINE, channels=tuple(c.channel for c in run.channels)))


class FewBlocks:
    """A run in memory."""

    path = Path("run")

    def __init__(self, blocks: list[Block]) -> None:
        self._blocks = blocks

    def offered(self) -> list[SourceColumn]:
        return []

    def proposed_time(self) -> TimeSource:
        return TimeSource()

    def blocks(self, *_: object) -> Iterator[Block]:
        return iter(self._blocks)


@pytest.mark.parametrize(("factor", "apart"), [(1e3, "1000 times too far apart"), (1e-6, "1e+06 times too close")])
def test_stamps_in_another_unit_of_time_are_named(
    factor: float, apart: str, motion: dict[str, Array], turn: ModelTurn
) -> None:
    run = with_clock(measured(motion, *COLUMNS[:2]), lambda times: factor * times, turns=True)
    the_line(implausible(run, turn, UNITS), COLUMNS[0], apart, "is the unit of the time wrong?")


@pytest.mark.parametrize("turns", [True, False])
@pytest.mark.parametrize(("shift_turns", "word"), [(2.5, "set forward"), (-0.5, "set back")])
def test_a_clock_that_is_set_while_the_machine_turns_is_named(
    shift_turns: float, word: str, turns: bool, motion: dict[str, Array], turn: ModelTurn
) -> None:
    run, shift_s = measured(motion, *COLUMNS[:3]), shift_turns * TURN / abs(turn.speed_rad_per_s)
    shifted = with_clock(run, lambda times_s: times_s + np.where(times_s > 2.0, shift_s, 0.0), turns=turns)
    the_line(implausible(shifted, turn, UNITS), COLUMNS[0], word, "Cut the run")
    the_line(implausible(shifted, None, UNITS), COLUMNS[0], word, "Cut the run")


@pytest.mark.parametrize("turns", [True, False])
@pytest.mark.parametrize("gap_s", [0.2, 0.5, 1.1])
def test_a_gap_during_which_the_crank_turned_is_no_fault_of_the_clock(
    gap_s: float, turns: bool, motion: dict[str, Array], turn: ModelTurn
) -> None:
    kept = (motion["time_s"] < 2.0) | (motion["time_s"] > 2.0 + gap_s)
    run = measured({name: values[kept] for name, values in motion.items()}, *COLUMNS[:3])
    assert implausible(with_clock(run, np.copy, turns=turns), None, UNITS) == []


@pytest.mark.parametrize("anew", [True, False])
@pytest.mark.parametrize(("shown", "told"), [("rad", "deg"), ("turn", "deg"), ("rad", "mrad")])
def test_a_crank_that_hardly_turns_in_its_unit_is_named_with_the_unit_shown(
    shown: str, told: str, anew: bool, motion: dict[str, Array], turn: ModelTurn
) -> None:
    angle = np.mod(motion[COLUMNS[0]], TURN) if anew else motion[COLUMNS[0]]
    numbers = {**motion, COLUMNS[0]: angle / UNITS_OF_MAPS[shown].factor}
    run = measured(numbers, COLUMNS[0], unit=told)
    read = with_values(run, COLUMNS[0], lambda values: values * UNITS_OF_MAPS[told].factor)
    the_line(implausible(read, turn, UNITS), "no cycle", f"is its unit {shown}?")


@pytest.mark.parametrize("packet", [5, 40])
def test_stamps_of_packets_are_named(packet: int, motion: dict[str, Array], turn: ModelTurn) -> None:
    whole = np.arange(len(motion["time_s"])) // packet * packet
    begun_s = motion["time_s"][whole]
    in_packets = {**motion, "time_s": begun_s + 0.05 * (motion["time_s"] - begun_s)}
    the_line(implausible(measured(in_packets, COLUMNS[0]), turn, UNITS), COLUMNS[0], "those of packets?")


def test_a_channel_that_shares_no_time_with_the_crank_is_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    run = measured(motion, *COLUMNS[:2])
    late = replace(run.channels[1], times_s=run.channels[1].times_s + 1e6)
    the_line(implausible(replace(run, channels=(run.channels[0], late)), turn, UNITS), COLUMNS[1], "two clocks?")


def test_no_cycle_is_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    short = {name: values[:40] for name, values in motion.items()}
    the_line(implausible(measured(short, *COLUMNS[:2]), turn, UNITS), "no cycle", "of a turn")


def test_a_speed_of_the_wrong_sign_is_named(motion: dict[str, Array], turn: ModelTurn) -> None:
    the_line(
        implausible(with_values(measured(motion, *COLUMNS), COLUMNS[3], np.negative), turn, UNITS),
        "opposite sign",
        "sign -1",
    )


@pytest.mark.slow
@settings(max_examples=15)
@given(st.floats(-6.0, 6.0), st.sampled_from([1, -1]), st.floats(0.2, 3.0))
def test_zero_sign_and_scale_are_found_by_correlation(zero: float, sign: int, scale: float) -> None:
    of = model_turn(built("compaction_press"))
    assert of is not None
    crank = np.linspace(0.3, 14.0, 800)
    shown = sign * scale * of.at("linkage.plate.position", crank)
    found = following(of, "linkage.plate.position", crank + zero, shown)
    off = (found.crank_zero_rad - zero + 0.5 * TURN) % TURN - 0.5 * TURN
    assert found.correlation > 0.9999
    assert (found.sign, found.crank_sign) == (sign, 1)
    assert abs(off) < 0.01
    assert found.scale == pytest.approx(scale, rel=1e-3)


@pytest.mark.parametrize(
    ("times", "values", "words"),
    [
        (np.arange(3.0), np.arange(3.0), ("3 samples", "expected at least")),
        (np.arange(50.0), np.full(50, 2.0), ("constant at 2",)),
        (np.arange(50.0) % 10.0, np.arange(50.0), ("go back 4 times", "50 samples")),
        (np.arange(50.0), np.full(50, np.nan), ("0 samples with a number",)),
    ],
)  # fmt: skip
def test_a_channel_beyond_use_is_refused(times: Array, values: Array, words: tuple[str, ...]) -> None:
    gauge = QualityGauge()
    gauge.add(Block(0, times, values, NO_DELAYS))
    channel = Channel.model_validate({"source": {"column": "angle"}, "is": "linkage.crank.position"})
    with pytest.raises(MeasurementError) as refused:
        require_usable(Path("run.csv"), channel, gauge.quality())
    assert all(word in str(refused.value) for word in ("run.csv", "angle", *words))


def read_angles(tmp_path: Path, times: Array, *shown: tuple[Array, dict[str, Any]]) -> list[Array]:
    """Return the values of angles of the crank, each read from a table with these keys of its channel."""
    pytest.importorskip("pyarrow")
    path = tmp_path / "a.csv"
    rows = zip(times.tolist(), *(values.tolist() for values, _ in shown), strict=True)
    names = [f"angle_{place}" for place in range(len(shown))]
    path.write_text("\n".join([",".join(["t", *names]), *(",".join(map(repr, row)) for row in rows)]), encoding="utf-8")
    keys = [key for _, key in shown]
    channels = [{"source": {"column": n}, "is": COLUMNS[0], **k} for n, k in zip(names, keys, strict=True)]
    tree = {"machine": MACHINE, "time": {"column": "t"}, "channels": channels}
    return [each.values for each in read_run(TableReader(path), MeasurementMap.model_validate(tree)).channels]


def test_wrapped_angles_are_unwrapped_and_counters_are_left_alone(tmp_path: Path) -> None:
    times = np.arange(400) * 0.01
    angle, fast = 9.0 * times, 3.5 * TURN * np.arange(400)
    counts = np.mod(angle / TURN * 4096.0, 4096.0)
    wrapped, turns, counter, encoder, unknown = read_angles(
        tmp_path,
        times,
        (np.degrees(angle) % 360.0, {"unit": "deg"}),
        (angle / TURN, {"unit": "turn"}),
        (fast, {"unit": "rad"}),
        (counts, {"unit": "count", "gain": TURN / 4096.0, "sign": -1}),
        (counts, {"unit": "count", "gain": "free"}),
    )
    assert wrapped == pytest.approx(angle, abs=1e-9)
    assert turns == pytest.approx(angle, abs=1e-9)
    assert np.diff(counter) == pytest.approx(np.full(399, 3.5 * TURN))
    assert encoder == pytest.approx(-angle, abs=1e-9)
    assert unknown == pytest.approx(counts)


def test_noise_behind_an_angle_that_starts_anew_hides_no_turn(tmp_path: Path) -> None:
    """An analogue sensor of 0 to 360 degrees shows a little more than a turn."""
    times = np.arange(0.0, 6.0, 0.01)
    angle = 9.0 * times
    noise = np.random.default_rng(1).normal(0.0, 1.0, len(times))
    (found,) = read_angles(tmp_path, times, (np.degrees(angle) % 360.0 + noise, {"unit": "deg"}))
    assert found == pytest.approx(angle + np.radians(noise), abs=1e-9)


@pytest.mark.parametrize("gap_s", [0.05, 0.3, 0.7, 1.9])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_wrapped_angle_turns_on_in_a_gap_as_around_it(gap_s: float, sense: float, tmp_path: Path) -> None:
    times = np.arange(0.0, 6.0, 0.01)
    times = times[(times < 3.0) | (times >= 3.0 + gap_s)]
    angle = sense * (12.0 * times + 0.4 * np.sin(12.0 * times) + 0.5 * times**2)  # uneven, and running up
    swinging = 1.2 * np.sin(12.0 * times)
    turning, rocking = read_angles(
        tmp_path, times, (np.degrees(angle) % 360.0, {"unit": "deg"}), (swinging, {"unit": "rad"})
    )
    assert turning - turning[0] == pytest.approx(angle - angle[0], abs=1e-9)
    assert rocking == pytest.approx(swinging)


@pytest.mark.parametrize("stamp", ["nan", "1.0", "inf", "-inf"])
def test_samples_without_a_time_of_their_own_are_no_measurement(stamp: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,x\n" + "".join(f"{stamp},{0.1 * row}\n" for row in range(100)), encoding="utf-8")
    tree = {
        "machine": "impact_mass",
        "time": {"column": "t", "unit": "s"},
        "channels": [{"source": {"column": "x"}, "is": "linkage.mass.position", "unit": "m"}],
    }
    with pytest.raises(MeasurementError, match=r"'x' \(linkage.mass.position\): [01] samples .* expected at least 8"):
        read_run(TableReader(path), MeasurementMap.model_validate(tree))


def test_a_sensor_that_stands_still_is_named_only_where_the_model_moves() -> None:
    machine, force, moment = built("vibration_crank"), "forces.guide.force_x_n", "forces.guide.moment_nm"
    rows = list(frames(machine, 3.0))[::5]
    own = {"time_s": np.array([row.linkage.time_s for row in rows])}
    own["linkage.crank.position"] = np.array([row.linkage.position[0] for row in rows])
    own |= {name: np.full(len(rows), 3.5) for name in (force, moment)}
    found, units = model_turn(machine), machine_columns(machine)
    the_line(implausible(measured(own, "linkage.crank.position", force, moment), found, units), force, "stuck")
