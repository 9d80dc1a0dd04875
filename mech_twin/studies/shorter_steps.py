# SPDX-License-Identifier: Apache-2.0
"""Repeats a run with shorter steps, to find how many digits of a number do not depend on the step.

Peaks are taken at samples, and roles exchange samples at steps, so that results depend on the step.  The second run has
sqrt 5 times as many steps: its step is below half, and its samples fall between those of the first run.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from mech_twin.capabilities.design import InShorterSteps
from mech_twin.capabilities.variation import varied
from mech_twin.engine.run import TIMES_AS_MANY, frames, shorter_step_s
from mech_twin.errors import StudyError
from mech_twin.parameters.live_change import ChangingMachine, LiveChange
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine
from mech_twin.samples import Frame
from mech_twin.studies.run_comparison import rounding_errors
from mech_twin.studies.simulation import ChangingObserver

DIGITS = 5  # reported at most, since both runs may miss a peak by the same amount
FIRST_ORDER = 1.0 / (1.0 - 1.0 / TIMES_AS_MANY)  # error over difference, for an error proportional to the step
ROUNDING = 1e-12  # of a number: below, two runs tell the same
FEWEST_DIGITS = 2  # with fewer, both numbers are reported instead


def in_shorter_steps(machine: Machine, duration_s: float) -> Machine | None:
    """Return the machine with a shorter coupling step that divides the run; None if that is not allowed."""
    try:
        parameters = varied(machine.parameters, {"coupling.step_s": shorter_step_s(machine, duration_s)})
    except ValidationError:
        return None
    return catalogue_entry(machine.name).build(parameters)


class RunInShorterSteps:
    """A run with shorter steps, simulated in parallel with the original run.

    Attributes
    ----------
    failure : str
        Error that ended this run early; empty without one.
    """

    def __init__(self, machine: Machine, duration_s: float, changes: Sequence[LiveChange] = ()) -> None:
        self.failure = ""
        changing = ChangingMachine(machine, changes)
        self.step_s = machine.coupling_step_s
        self._observer = ChangingObserver(machine, changing.at)
        self._frames: Iterator[Frame] = frames(machine, duration_s, changing.command, changing.at)
        self._time_s = -math.inf

    def follow(self, other: Frame) -> None:
        """Simulate up to the time of a frame of the other run; an error ends only this run."""
        self._observe_until(other.linkage.time_s)

    def finish(self) -> None:
        """Simulate to the end."""
        self._observe_until(math.inf)

    def _observe_until(self, time_s: float) -> None:
        try:
            while self._time_s < time_s and (frame := next(self._frames, None)) is not None:
                self._observer.observe(frame)
                self._time_s = frame.linkage.time_s
        except (ArithmeticError, ValueError) as error:
            self.failure, self._frames = str(error) or type(error).__name__, iter(())

    def numbers(self, names: Iterable[str]) -> dict[str, float]:
        """Return the metrics of these names so far, NaN for an unknown name; empty if the run failed."""
        if self.failure:
            return {}
        found = self._observer.numbers()
        return {name: found.get(name, math.nan) for name in names}


def checked_numbers(machine: Machine, duration_s: float, names: Iterable[str]) -> InShorterSteps:
    """Return metrics of a run with shorter steps.

    Raises
    ------
    StudyError
        No shorter step is allowed, or the run with it fails.
    """
    shorter = in_shorter_steps(machine, duration_s)
    if shorter is None:
        raise StudyError(f"{machine.name}: no coupling step shorter than {machine.coupling_step_s:g} s is allowed")
    run = RunInShorterSteps(shorter, duration_s)
    run.finish()
    if run.failure:
        raise StudyError(f"{machine.name}: the run in steps of {run.step_s:g} s ended: {run.failure}")
    return InShorterSteps(run.step_s, machine.coupling_step_s, run.numbers(names))


def in_common_digits(numbers: Mapping[str, Any], shorter: Mapping[str, float]) -> dict[str, Any]:
    """Return numbers in the digits that they have in shorter steps too; those that are rounding errors are 0."""
    errors = rounding_errors(numbers, shorter)
    return {name: common_digits(name, value, shorter, errors[name]) for name, value in numbers.items()}


def common_digits(name: str, value: Any, shorter: Mapping[str, float], rounding_error: float = 0.0) -> Any:
    """Return a number with the digits that do not depend on the step; both numbers if these are too few.

    Half of the last digit is at least the error, assumed proportional to the step.  A number that is absent from
    ``shorter`` does not depend on the run and is returned unchanged.  Numbers of two runs that are both within
    ``rounding_error`` of 0 are 0.

    Examples
    --------
    >>> common_digits("peak_n", 4248.81475, {"peak_n": 4251.16915})
    '4250'
    >>> common_digits("gap_m", 2.0e-4, {"gap_m": 2.9e-4})
    '0.0002 to 0.00029'
    """
    if name not in shorter or math.isclose(value, shorter[name], rel_tol=ROUNDING):
        return value
    other = shorter[name]
    if not (math.isfinite(value) and math.isfinite(other)):
        return value if math.isnan(value) and math.isnan(other) else _both(value, other)
    if max(abs(value), abs(other)) <= rounding_error:
        return 0.0
    last = math.ceil(math.log10(2.0 * FIRST_ORDER * abs(value - other)))
    size = math.floor(math.log10(abs(value))) + 1 if value else last
    last = max(last, size - DIGITS)
    digits = size - last
    return _rounded(value, digits, last) if digits >= FEWEST_DIGITS else _both(value, other)


def _rounded(value: float, digits: int, last: int) -> str:
    """Return a number with this many digits, the last of them at this power of ten."""
    if 1e-4 <= abs(value) < 10.0**6:
        return f"{round(value, -last):.{max(0, -last)}f}"
    return f"{value:.{digits - 1}e}"


def _both(value: float, other: float) -> str:
    return f"{value:.3g} to {other:.3g}".replace("nan", "none")
