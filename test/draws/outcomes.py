# SPDX-License-Identifier: Apache-2.0
"""What becomes of a drawn configuration, and what it must keep.

Each is analysed at several crank angles and simulated for half a second, in half of the random ones with the drive
switched off and on again.  Every number must be finite and every residual within its limit; what is refused must be
refused in one line that names a key and a number.  Through the command an answer is whole and finite, or a refusal of
one line.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any, NamedTuple
from unittest import mock

from draws.keys import Change, Changed, Refused, leaves
from draws.random_draw import STEP, Draw

from mech_twin.cli import console
from mech_twin.cli.main import main
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree, merged_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import Residual, broken_lines, frame_events, frame_numbers
from mech_twin.errors import MotionError
from mech_twin.files.output_file import json_text
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.description import description_text
from mech_twin.roles import Machine
from mech_twin.samples import Frame

RUN_S = 0.5
ANGLES_RAD = (0.0, 1.0, math.pi, 5.5)
SHORTER_STEP = re.compile(r"coupling\.step_s \S+ is too long for this machine, try (\S+)$")
MOST_TOLD = 3  # shorter steps, each told by the run before
RAN, UNBUILT, REFUSED_IN_RUN, BROKEN = "ran", "refused at configuration", "refused in the run", "broken"

COMMAND_RUN_S = 0.05
COMMAND_STEPS = 50  # where the coupling step itself is changed
VERBS = ("analyse", "simulate")
ANSWERED, REFUSED, BALANCE = "answered", "refused in one line", "a balance over its limit, said in one line"


class Outcome(NamedTuple):
    """What became of one configuration: its end and the words for it.

    ``margin`` is the worst residual over its limit, ``seconds`` processor time.
    """

    number: int
    end: str
    what: str
    margin: float = 0.0
    refused: int = 0
    seconds: float = 0.0
    text: str = ""


def numbers_in(tree: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield every float of nested records, groups and lists, with its name."""
    if is_dataclass(tree):
        tree = vars(tree)
    elif hasattr(tree, "_asdict"):
        tree = tree._asdict()
    elif hasattr(tree, "tolist"):
        tree = tree.tolist()
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            yield from numbers_in(value, f"{name}.{key}")
    elif isinstance(tree, list | tuple):
        for value in tree:
            yield from numbers_in(value, name)
    elif isinstance(tree, float):
        yield name, tree


def bad_refusal(name: str, refused: Refused) -> str:
    """Return what is wrong with a refusal: it must be one line with a key of the model, and a number or an option."""
    known = list(leaves(CATALOGUE[name].parameters))
    options = {word for leaf in known for word in leaf.options if isinstance(word, str)}
    keys = {leaf.path[-1] for leaf in known} | set(refused.key.split("."))
    text = refused.message.removeprefix("draw").replace(name, "")  # the 10 of a machine's name is no number told
    expected = any(letter.isdigit() for letter in text) or any(option in text for option in options)
    good = "\n" not in text and any(key in text for key in keys) and expected
    return "" if good else f"refusal of {refused.key} = {refused.value}: {refused.message}"


def worst_margin(machine: Machine, frame: Frame) -> tuple[float, str]:
    """Return the largest residual of a frame over its limit, nan counting as infinite, and what is told of it."""
    worst, which = 0.0, ""
    roles = ((machine.linkage, frame.linkage), (machine.forces, frame.forces), (machine.body, frame.body))
    for role, sample in roles:
        if role is None or sample is None:
            continue
        for residual, value in sample.residuals.as_dict().items():
            limit = role.residual_limits[residual]
            margin = abs(value) / limit
            if not margin <= worst:
                told = broken_lines({residual: Residual(abs(value), limit)}, machine.coupling_step_s)
                worst, which = math.inf if math.isnan(margin) else margin, "".join(told)
    return worst, which


def run(machine: Machine, commands: tuple[float, ...], most_steps: float = math.inf) -> tuple[str, float]:
    """Return what a run and the analyses break first, or nothing, and the worst residual over its limit."""
    analyses = {"report": machine.report(), "analyse": [machine.analyse(angle) for angle in ANGLES_RAD]}
    for name, value in numbers_in(analyses):
        if not math.isfinite(value):
            return f"{name} = {value}", 0.0
    run_s = min(RUN_S, most_steps * machine.coupling_step_s)
    observer, steps, worst = machine.observer(), round(run_s / machine.coupling_step_s), 0.0
    for frame in frames(machine, run_s, lambda step: commands[step * len(commands) // (steps + 1)]):
        observer.observe(frame)
        at = f"at {frame.linkage.time_s:g} s"
        for name, value in frame_numbers(frame):
            if not math.isfinite(value):
                return f"{name} = {value} {at}", worst
        for event in frame_events(frame):
            if not math.isfinite(event.time_s + event.impulse_ns):
                return f"{event.kind} is not finite {at}", worst
        margin, which = worst_margin(machine, frame)
        worst = max(worst, margin)
        if margin > 1.0:
            return f"{at}: {which}", worst
    for name, value in numbers_in(observer.numbers()):
        if not math.isfinite(value):
            return f"metrics: {name} = {value}", worst
    return "", worst


def outcome_of(number: int, make: Callable[[], Draw | Changed], most_steps: float = math.inf) -> Outcome:
    """Return what became of one configuration, which is made here so that what this raises counts as broken."""
    begun, margin, refused, text = time.process_time(), 0.0, 0, ""
    try:
        drawn = make()
        parameters, refused = drawn.parameters, len(drawn.refused)
        bad = next(filter(None, (bad_refusal(drawn.name, one) for one in drawn.refused)), "")
        if parameters is not None:
            text = f"# drive: {drawn.commands}\n" + description_text(drawn.name, parameters)
        if bad:
            end, what = BROKEN, bad
        elif parameters is None:
            end, what = UNBUILT, drawn.refused[0].message
        else:
            end, what, margin = end_of_run(drawn.name, parameters, drawn.commands, most_steps)
    except Exception as error:  # noqa: BLE001 - what a legal input must never end in
        end, what = BROKEN, f"{type(error).__name__}: {error}"
    return Outcome(number, end, what, margin, refused, time.process_time() - begun, text)


def end_of_run(
    name: str, parameters: Parameters, commands: tuple[float, ...], most_steps: float = math.inf
) -> tuple[str, str, float]:
    """Return the end of a legal configuration, its words, and its worst residual over its limit.

    A run that tells its coupling step too long, and a shorter one to try, is a refusal if what it tells is so.
    """
    try:
        machine = CATALOGUE[name].build(parameters)
    except ConfigurationError as refusal:
        return judged(name, UNBUILT, refusal)
    try:
        broken, margin = run(machine, commands, most_steps)
        if not broken:
            return RAN, "", margin
        held = _holds_as_told(name, parameters, commands, broken)
        return (REFUSED_IN_RUN if held else BROKEN), broken, margin
    except MotionError as refusal:
        return judged(name, REFUSED_IN_RUN, refusal)


def _holds_as_told(name: str, parameters: Parameters, commands: tuple[float, ...], told: str) -> bool:
    """Return whether a run that is broken tells a coupling step with which it is not, or which tells another."""
    for _ in range(MOST_TOLD):
        shorter = SHORTER_STEP.search(told)
        if shorter is None:
            return False
        told, _margin = run(CATALOGUE[name].build(_with_step(parameters, float(shorter[1]))), commands)
        if not told:
            return True
    return False


def _with_step(parameters: Parameters, step_s: float) -> Parameters:
    tree = merged_tree(configuration_tree(parameters), {"coupling": {"step_s": step_s}})
    return type(parameters).model_validate(tree)


def judged(name: str, end: str, refusal: Exception) -> tuple[str, str, float]:
    """Return the end of a configuration that is refused: broken where it is not refused as it should be."""
    bad = bad_refusal(name, Refused(end, "", str(refusal)))
    return (BROKEN if bad else end), bad or str(refusal), 0.0


class CommandOutcome(NamedTuple):
    """What became of a change through the command: of each verb a good end, or what is wrong; and the time it took."""

    ends: dict[str, str]
    seconds: float


def command_outcome(name: str, change: Change) -> CommandOutcome:
    """Return what becomes of an analysis and a short simulation with a change."""
    begun = time.perf_counter()
    steps_run = 0.0 < change.value < 1.0 and change.path[-1] == STEP
    run_s = COMMAND_STEPS * change.value if steps_run else COMMAND_RUN_S
    setting = [name, "--json", "--set", f"{change.key}={change.value!r}"]
    more = {"analyse": ["--crank-deg", "40"], "simulate": ["--duration", repr(run_s)]}
    ends = {verb: _end_of_command([verb, *setting, *more[verb]]) for verb in VERBS}
    return CommandOutcome(ends, time.perf_counter() - begun)


def _end_of_command(words: list[str]) -> str:
    """Run one command in this process; return its good end, or what is wrong with it."""
    said, errors, infinite = io.StringIO(), io.StringIO(), list[str]()

    def noticed(document: Any) -> str:
        infinite.extend(_infinite(document))
        return json_text(document)

    with mock.patch.object(console, "json_text", noticed), mock.patch.object(sys, "argv", ["mech-twin", *words]):
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
                main()
        except SystemExit as end:
            return _end_told(end.code, said.getvalue(), errors.getvalue(), infinite)
        except Exception as error:  # noqa: BLE001 - what must never happen
            return f"{type(error).__name__}: {error}"
    return "the command did not end"


def _infinite(document: Any) -> Iterator[str]:
    """Yield the infinite numbers of a document, but those of the configuration: infinity is a word of some keys."""
    for name, value in numbers_in(document):
        if math.isinf(value) and ".config." not in f"{name}.":
            yield f"{name} = {value}"


def _end_told(code: Any, said: str, errors: str, infinite: list[str]) -> str:
    if code == 0:
        json.loads(said)
        return f"not finite: {infinite[0]}" if infinite else ANSWERED
    if code == 1 and errors.count("\n") >= 1 and "Traceback" not in errors:
        return BALANCE
    if code == 2 and errors.count("\n") == 1 and errors.startswith("mech-twin: ") and not said:
        return REFUSED
    return f"exit code {code}: {errors[-300:]}"
