# SPDX-License-Identifier: Apache-2.0
"""What each random legal configuration of a machine must keep.

Each configuration is analysed at several crank angles and simulated for half a second, in half of them with the drive
switched off and on again.  Every number must be finite and every residual within its limit; each value that is refused
on the way must be refused in one line that names a key and a number.  benchmarks/reliability/random_draws.py
makes many.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from typing import Any, NamedTuple, get_args

from configuration_draws import Draw, Refused, leaves

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree, merged_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.errors import MotionError
from mech_twin.engine.invariants import Residual, broken_lines
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events, frame_numbers
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import description_text
from mech_twin.roles import Machine
from mech_twin.samples import Frame

RUN_S = 0.5
ANGLES_RAD = (0.0, 1.0, math.pi, 5.5)
SHORTER_STEP = re.compile(r"coupling\.step_s \S+ is too long for this machine, try (\S+)$")
MOST_TOLD = 3  # shorter steps, each told by the run before
RAN, UNBUILT, REFUSED_IN_RUN, BROKEN = "ran", "refused at configuration", "refused in the run", "broken"


class Outcome(NamedTuple):
    """What became of one draw: its end and the words for it.

    ``margin`` is the worst residual over its limit, ``seconds`` processor time.
    """

    number: int
    end: str
    what: str
    margin: float
    refused: int
    seconds: float
    text: str


def numbers_in(tree: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield every float of nested groups and lists, with its name."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from numbers_in(value, f"{name}.{key}")
    elif isinstance(tree, list | tuple):
        for value in tree:
            yield from numbers_in(value, name)
    elif isinstance(tree, float):
        yield name, tree


def bad_refusal(name: str, refused: Refused) -> str:
    """Return what is wrong with a refusal: it must be one line with a key of the model, and a number or an option."""
    options = {str(word) for leaf in leaves(CATALOGUE[name].parameters) for word in get_args(leaf.kinds[0])}
    keys = {leaf.path[-1] for leaf in leaves(CATALOGUE[name].parameters)} | set(refused.key.split("."))
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


def run(machine: Machine, commands: tuple[float, ...], run_s: float = RUN_S) -> tuple[str, float]:
    """Return what a run and the analyses break first, or nothing, and the worst residual over its limit."""
    analyses = {"report": machine.report(), "analyse": [machine.analyse(angle) for angle in ANGLES_RAD]}
    for name, value in numbers_in(analyses):
        if not math.isfinite(value):
            return f"{name} = {value}", 0.0
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


def outcome_of(name: str, seed: int, number: int) -> Outcome:
    """Return what became of one draw."""
    begun, margin, refused, text = time.process_time(), 0.0, 0, ""
    try:
        draw = Draw(name, seed, number)
        refused = len(draw.refused)
        text = f"# drive: {draw.commands}\n" + description_text(name, draw.parameters)
        end, what = BROKEN, next(filter(None, (bad_refusal(name, one) for one in draw.refused)), "")
        if not what:
            end, what, margin = end_of_run(name, draw.parameters, draw.commands)
    except Exception as error:  # noqa: BLE001 - what a legal input must never end in
        end, what = BROKEN, f"{type(error).__name__}: {error}"
    return Outcome(number, end, what, margin, refused, time.process_time() - begun, text)


def end_of_run(name: str, parameters: Parameters, commands: tuple[float, ...]) -> tuple[str, str, float]:
    """Return the end of a configuration, its words, and its worst residual over its limit.

    A run that tells its coupling step too long, and a shorter one to try, is a refusal if what it tells is so.
    """
    try:
        machine = CATALOGUE[name].build(parameters)
    except ConfigurationError as refusal:
        return judged(name, UNBUILT, refusal)
    try:
        broken, margin = run(machine, commands)
        if not broken:
            return RAN, "", margin
        return (REFUSED_IN_RUN if _holds_as_told(name, parameters, commands, broken) else BROKEN), broken, margin
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
