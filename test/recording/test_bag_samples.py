# SPDX-License-Identifier: Apache-2.0
"""A bag gives back the samples that went into it: each step once, whatever else it holds."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from catalogue import built
from command_line import mech_twin
from recordings import Entry, altered_bag, earlier_layout, edited, entries_of, simulated_bag, written_bag
from rrd_tables import rrd_tables

from mech_twin.engine.trajectory import StepSamples
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.nodes.replay.source import ReplaySource
from mech_twin.nodes.run.composition import run_in_process
from mech_twin.parameters.load import machine_parameters
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_samples import LATER, BagSamples, bag_samples
from mech_twin.recording.errors import BagError
from mech_twin.samples import Drawing, Frame

DRUM = "winding_drum"
STATES = f"/{DRUM}/step/linkage"
MOTOR = f"/{DRUM}/step/motor"


@pytest.fixture
def frames(tmp_path: Path) -> list[Frame]:
    return simulated_bag(DRUM, 0.1, tmp_path / "bag")


def test_samples_of_a_bag_are_those_of_the_run(frames: list[Frame], tmp_path: Path) -> None:
    steps = list(bag_samples(tmp_path / "bag"))
    assert [step.frame(has_body=False) for step in steps] == frames


def test_a_bag_of_before_the_step_topics_gives_the_same_samples(frames: list[Frame], tmp_path: Path) -> None:
    bag = altered_bag(tmp_path / "bag", tmp_path / "earlier", earlier_layout)
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        assert "/winding_drum/step/linkage" not in reader.topics
        assert [step.frame(has_body=False) for step in samples.steps()] == frames
        assert samples.topics["forces"] == "/winding_drum/forces/joint_states"
        assert not samples.unused


@pytest.mark.slow
def test_a_run_in_the_root_namespace_reads_and_shows_as_any(frames: list[Frame], tmp_path: Path) -> None:
    at_root = tmp_path / "root"
    altered_bag(
        tmp_path / "bag", at_root, lambda entry: [entry._replace(topic=entry.topic.removeprefix("/winding_drum"))]
    )
    assert [step.frame(has_body=False) for step in bag_samples(at_root)] == frames
    for arguments in (("replay", at_root, "--resimulate"), ("view", at_root, "--save", tmp_path / "run.rrd")):
        done = mech_twin(*map(str, arguments))
        assert done.code == 0, done.err


def test_a_view_shows_answers_that_number_no_step(frames: list[Frame], tmp_path: Path) -> None:
    def plain(message: Any) -> None:
        kept = [place for place, name in enumerate(message.name) if not name.startswith("~")]
        for column in ("name", "position", "velocity", "effort"):
            setattr(message, column, [getattr(message, column)[place] for place in kept])

    def of_users_motor(entry: Entry) -> list[Entry]:
        return [edited(entry, plain) if entry.topic == MOTOR else entry]

    bag = altered_bag(tmp_path / "bag", tmp_path / "own", of_users_motor)
    done = mech_twin("view", bag, "--save", tmp_path / "run.rrd")
    assert done.code == 0
    assert "not used" not in done.err


def test_drawings_come_between_the_steps_at_their_time(frames: list[Frame], tmp_path: Path) -> None:
    with BagReader(tmp_path / "bag") as reader:
        shown = list(BagSamples(reader).shown())
    drawings = [item for item in shown if isinstance(item, Drawing)]
    assert [item.step for item in shown if isinstance(item, StepSamples)] == [f.linkage.step for f in frames]
    assert [round(drawing.time_s, 9) for drawing in drawings] == [0.0, 0.033, 0.066, 0.099]
    assert all(drawing.shapes for drawing in drawings)


def test_a_recording_without_drawings_is_drawn_by_its_machine(frames: list[Frame], tmp_path: Path) -> None:
    scene = f"/{DRUM}/scene"
    with BagReader(tmp_path / "bag") as reader:
        assert scene in reader.topics
        assert BagSamples(reader).has_drawings
    plain = altered_bag(tmp_path / "bag", tmp_path / "plain", lambda entry: [entry] if entry.topic != scene else [])
    with BagReader(plain) as reader:
        assert not BagSamples(reader).has_drawings
    done = mech_twin("view", plain, "--save", tmp_path / "plain.rrd")
    assert done.code == 0, done.err
    figures = rrd_tables(tmp_path / "plain.rrd")[0]["/mechanism/figure"]
    assert [at.total_seconds() for at in figures["sim_time"].to_pylist()] == pytest.approx([0.0, 0.034, 0.067, 0.1])


def test_a_step_recorded_twice_counts_once(frames: list[Frame], tmp_path: Path) -> None:
    def twice(entry: Entry) -> Iterable[Entry]:
        return (entry, entry) if entry.topic == MOTOR else (entry,)

    bag = altered_bag(tmp_path / "bag", tmp_path / "twice", twice)
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        assert [step.frame(has_body=False) for step in samples.steps()] == frames
    assert samples.unused == {"repeated": len(frames)}


def test_of_two_answers_to_a_step_the_first_counts(frames: list[Frame], tmp_path: Path) -> None:
    def answered_again(entry: Entry) -> Iterable[Entry]:
        if entry.topic != MOTOR:
            return (entry,)
        return entry, edited(entry, lambda message: message.effort.__setitem__(0, 1e6))

    bag = altered_bag(tmp_path / "bag", tmp_path / "again", answered_again)
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        assert [step.frame(has_body=False) for step in samples.steps()] == frames
    assert samples.unused == {"contradicting": len(frames)}


@pytest.mark.parametrize(
    ("strange", "identical", "code"), [("earlier", None, 1), ("later", True, 0), ("alone", False, 1)]
)
def test_a_step_published_twice_makes_a_difference_uncertain_and_once_certain(
    frames: list[Frame], tmp_path: Path, strange: str, identical: bool | None, code: int
) -> None:
    def spoken(entry: Entry) -> Iterable[Entry]:
        if entry.topic != MOTOR or entry.log_time_ns < 60_000_000:
            return (entry,)
        other = edited(entry, lambda message: message.effort.__setitem__(0, 1e6))
        return {"earlier": (other, entry), "later": (entry, other), "alone": (other,)}[strange]

    bag = altered_bag(tmp_path / "bag", tmp_path / "spoken", spoken)
    ended = mech_twin("replay", bag, "--resimulate", "--json")
    found = json.loads(ended.out)
    assert (found["identical"], ended.code) == (identical, code)
    assert found["contradicted_from_step"] == (None if strange == "alone" else 60)
    words = mech_twin("replay", bag, "--resimulate").err
    assert ("not certain from step 60 on" in words) == (strange == "earlier")


def test_messages_out_of_order_give_steps_in_order(frames: list[Frame], tmp_path: Path) -> None:
    entries = entries_of(tmp_path / "bag")
    bag = written_bag(tmp_path / "disordered", reversed(entries))
    assert [step.frame(has_body=False) for step in bag_samples(bag)] == frames


def test_garbage_and_numbers_that_are_not_finite_are_counted_and_not_used(
    frames: list[Frame], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    garbage = {0: b"", 1: b"\x00\x01\x00\x00\xff\xff\xff\x7f", 2: b"garbage" * 9}

    def damaged(entry: Entry) -> Iterable[Entry]:
        step = round(entry.log_time_ns / 1e6)
        if entry.topic != MOTOR or step > 3:
            return (entry,)
        if step in garbage:
            return (entry._replace(raw=garbage[step]),)
        return (edited(entry, lambda message: message.effort.__setitem__(0, float("nan"))),)

    bag = altered_bag(tmp_path / "bag", tmp_path / "damaged", damaged)
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        steps = list(samples.steps())
    assert samples.unused == {"malformed": 4}
    assert [step.motor is None for step in steps[:5]] == [True, True, True, True, False]
    assert [step.linkage for step in steps] == [frame.linkage for frame in frames]


def test_a_machine_the_catalogue_does_not_know_opens_all_the_same(frames: list[Frame], tmp_path: Path) -> None:
    bag = altered_bag(
        tmp_path / "bag", tmp_path / "other", lambda e: (e._replace(topic=e.topic.replace(DRUM, "somebodys_press")),)
    )
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        assert samples.machine == "somebodys_press"
        assert [step.frame(has_body=False) for step in samples.steps()] == frames


def test_two_machines_in_one_bag_are_told_apart(frames: list[Frame], tmp_path: Path) -> None:
    bag = altered_bag(
        tmp_path / "bag", tmp_path / "two", lambda e: (e, e._replace(topic=e.topic.replace(DRUM, "other")))
    )
    with BagReader(bag) as reader, pytest.raises(BagError, match=f"more than one machine: other, {DRUM}"):
        BagSamples(reader)


def test_a_bag_without_a_machine_is_refused_in_one_line(tmp_path: Path) -> None:
    bag = written_bag(tmp_path / "bag", [Entry("/chatter", "std_msgs/msg/String", 0, b"\x00\x01\x00\x00\x01\0\0\0\0")])
    with BagReader(bag) as reader, pytest.raises(BagError, match="no samples of a machine") as caught:
        BagSamples(reader)
    assert "\n" not in str(caught.value)


def test_the_description_is_the_run_s_own(frames: list[Frame], tmp_path: Path) -> None:
    with BagReader(tmp_path / "bag") as reader:
        texts = BagSamples(reader).descriptions()
    assert len(texts) == 1
    assert f"machine: {DRUM}" in texts[0]
    silent = altered_bag(
        tmp_path / "bag", tmp_path / "silent", lambda e: () if e.topic.endswith("/description") else (e,)
    )
    with BagReader(silent) as reader:
        assert BagSamples(reader).descriptions() == texts


def described(entry: Entry, source: int | None, setting: str) -> Entry:
    """Return a description like the recorded one, signed by somebody, with one setting of its own."""

    def edit(message: Any) -> None:
        head = "" if source is None else f"source: {source}\n"
        unsigned = re.sub(r"^source: .*\n", "", message.data, flags=re.MULTILINE)
        message.data = head + re.sub(r"yarn_speed_m_per_s: .*", setting, unsigned)

    return edited(entry, edit)


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("signed", [True, False], ids=["signed", "unsigned"])
@pytest.mark.parametrize("stranger", [None, 17], ids=["unsigned stranger", "signed stranger"])
def test_a_strangers_description_in_a_bag_is_not_the_run_s(signed: bool, stranger: int | None, tmp_path: Path) -> None:
    if signed:
        options = RunOptions(pace="max", duration_s=0.1, recorder=True, exclusive=False)
        run_in_process(DRUM, built(DRUM).parameters, options, tmp_path / "bag", None)
    else:
        simulated_bag(DRUM, 0.1, tmp_path / "bag")

    def among(entry: Entry) -> Iterable[Entry]:
        if not entry.topic.endswith("/description"):
            return (entry,)
        foreign = described(entry, stranger, "yarn_speed_m_per_s: 1.0")
        later = [foreign._replace(log_time_ns=entry.log_time_ns + k * 10_000_000) for k in range(3)]
        return (foreign, entry, *later)

    bag = altered_bag(tmp_path / "bag", tmp_path / "among", among)
    with BagReader(tmp_path / "bag") as reader:
        own = BagSamples(reader).descriptions()
    with BagReader(bag) as reader:
        texts = BagSamples(reader).descriptions()
    if signed or stranger is not None:
        assert texts == own
    else:  # nothing tells them apart: a simulation signs nothing, and neither does the stranger
        assert set(own) < set(texts)


def test_a_bag_that_holds_a_strangers_description_alone_falls_back_to_its_own_configuration(tmp_path: Path) -> None:
    simulated_bag(DRUM, 0.05, tmp_path / "bag")
    bag = altered_bag(
        tmp_path / "bag",
        tmp_path / "alone",
        lambda e: (described(e, 17, "yarn_speed_m_per_s: 1.0"),) if e.topic.endswith("/description") else (e,),
    )
    with BagReader(bag) as reader:
        (text,) = BagSamples(reader).descriptions()
        assert text == reader.info.configuration
        assert "yarn_speed_m_per_s: 1.0" not in text


def mutated(entry: Entry, chance: random.Random) -> Entry:
    """Return the entry with some of its bytes changed, cut off, or given an absurd length."""
    raw = bytearray(entry.raw)
    kind = chance.randrange(4)
    if kind == 0:
        del raw[chance.randrange(len(raw) + 1) :]
    elif kind == 1:
        for _ in range(chance.randrange(1, 10)):
            raw[chance.randrange(len(raw))] = chance.randrange(256)
    elif kind == 2:
        at = 4 * chance.randrange(len(raw) // 4)
        raw[at : at + 4] = chance.choice([b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\x00\x00\x00\x10"])
    else:
        raw = bytearray(chance.randbytes(chance.randrange(200)))
    return entry._replace(raw=bytes(raw))


@pytest.mark.slow
def test_mutated_messages_are_counted_and_never_fatal(
    frames: list[Frame], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    chance = random.Random(5)
    everything = [mutated(entry, chance) for _ in range(5) for entry in entries_of(tmp_path / "bag")]
    assert len(everything) > 1000
    sound = [entry for entry in entries_of(tmp_path / "bag") if entry.topic == STATES]
    bag = written_bag(tmp_path / "mutated", sorted([*everything, *sound], key=lambda entry: entry.log_time_ns))
    with BagReader(bag) as reader:
        samples = BagSamples(reader)
        assert sum(isinstance(item, StepSamples) for item in samples.shown()) >= 1
        assert samples.unused["malformed"] > 500
        assert isinstance(samples.descriptions(), list)
        played = sum(1 for _ in ReplaySource(reader).messages(0))
        assert len(sound) <= played < len(everything) + len(sound)
    capfd.readouterr()  # the CDR library writes a line of its own for each


@pytest.mark.usefixtures("ros_domain")
def test_of_two_runs_in_one_recording_the_first_is_read(tmp_path: Path) -> None:
    """A recorder of others goes on through the runs: steps of a longer second run were taken for the first one's."""
    merged: list[Entry] = []
    for number, yarn_speed in enumerate((5.0, 4.0)):
        parameters = machine_parameters(DRUM, overrides={"yarn_speed_m_per_s": yarn_speed})
        options = RunOptions(pace="max", duration_s=0.1 + 0.1 * number, recorder=True, exclusive=False)
        run_in_process(DRUM, parameters, options, tmp_path / f"run_{number}", None)
        entries = entries_of(tmp_path / f"run_{number}")
        merged += [entry._replace(log_time_ns=entry.log_time_ns + number * 10**9) for entry in entries]
    both, first = written_bag(tmp_path / "both", merged), tmp_path / "run_0"
    with BagReader(both) as reader, BagReader(first) as of_first:
        samples, alone = BagSamples(reader), BagSamples(of_first)
        assert samples.descriptions() == alone.descriptions()
        assert list(samples.shown()) == list(alone.shown())
    assert samples.unused == {LATER: 3 * 201}
    told = mech_twin("replay", both, "--resimulate")
    assert told.code == 0
    assert "603 recorded samples not used: of a later run" in told.err


@pytest.mark.usefixtures("ros_domain")
def test_a_linkage_restarted_at_step_0_begins_no_other_run(tmp_path: Path) -> None:
    """It had waited for its peers, which had answered its step 0."""
    options = RunOptions(pace="max", duration_s=0.1, recorder=True, exclusive=False)
    run_in_process(DRUM, built(DRUM).parameters, options, tmp_path / "bag", None)
    entries = entries_of(tmp_path / "bag")
    killed = [described(entry, 17, "yarn_speed_m_per_s: 5.0") for entry in entries if "/description" in entry.topic]

    def of_the_killed(message: Any) -> None:
        message.velocity[message.name.index("~revision")] = 17.0

    answered = (STATES, f"/{DRUM}/step/forces")
    killed += [edited(next(each for each in entries if each.topic == topic), of_the_killed) for topic in answered]
    bag = written_bag(tmp_path / "restarted", [*killed, *entries])
    with BagReader(bag) as reader, BagReader(tmp_path / "bag") as of_run:
        samples, alone = BagSamples(reader), BagSamples(of_run)
        assert samples.descriptions() == alone.descriptions()
        assert [step.step for step in samples.steps()] == list(range(101))


def test_of_a_recording_of_two_machines_info_names_both(frames: list[Frame], tmp_path: Path) -> None:
    simulated_bag("vibration_crank", 0.05, tmp_path / "crank")
    both = written_bag(tmp_path / "both", [*entries_of(tmp_path / "bag"), *entries_of(tmp_path / "crank")])
    assert mech_twin("info", both).out.startswith(f"vibration_crank, {DRUM}, 0.1 s; complete")
