# SPDX-License-Identifier: Apache-2.0
"""Assembly of steps from samples that arrive one by one, from topics or from a recording."""

from __future__ import annotations

from collections import Counter
from typing import Any

from mech_twin.engine.trajectory import StepSamples
from mech_twin.samples import BodySample, ForceSample, Frame, LinkageSample, MotorSample, Sample

OPEN_STEPS = 64
FIELDS: dict[type, str] = {
    LinkageSample: "linkage",
    MotorSample: "motor",
    ForceSample: "forces",
    BodySample: "body",
}


class StepAssembler:
    """Joins samples to steps and gives the steps back in ascending order, each once.

    A step is given back as soon as it has every expected sample.  Each source sends its samples in order, so the
    steps still open below a complete one have lost a sample and are given back, incomplete, before it.  At most
    `OPEN_STEPS` steps wait at a time; then the lowest is given back as it is.

    Parameters
    ----------
    fields : frozenset of str
        The fields of `StepSamples` that make a step complete.
    unused : Counter, optional
        Counts the samples not used, by reason: ``repeated`` (equal to the first of its step), ``contradicting``
        (differs from it; the first one counts), ``late`` (its step has been given back already).

    Attributes
    ----------
    incomplete : int
        Steps given back with a sample missing.
    contradicted_from : int or None
        The lowest step with two different samples of one role: a second publisher must have sent one of them.
    """

    def __init__(self, fields: frozenset[str], unused: Counter[str] | None = None) -> None:
        self.unused: Counter[str] = Counter() if unused is None else unused
        self.incomplete = 0
        self.contradicted_from: int | None = None
        self._fields = fields
        self._open: dict[int, dict[str, Any]] = {}
        self._newest: StepSamples | None = None
        self._given: dict[int, StepSamples] = {}  # the newest ones

    def add(self, sample: Sample) -> list[StepSamples]:
        """Return the steps that this sample completes or forces out, lowest first."""
        field = FIELDS[type(sample)]
        if self._newest is not None and sample.step <= self._newest.step:
            given = self._given.get(sample.step)
            self._count_unused(sample, None if given is None else getattr(given, field))
            return []
        known = self._open.get(sample.step)
        if known is None:
            known = self._open[sample.step] = {}
        if field in known:
            self._count_unused(sample, known[field])
            return []
        known[field] = sample
        if len(known) == len(self._fields) and known.keys() == self._fields:
            if len(self._open) == 1:
                return [self._given_back(sample.step)]
            return [self._given_back(step) for step in sorted(self._open) if step <= sample.step]
        return [self._given_back(min(self._open))] if len(self._open) > OPEN_STEPS else []

    def rest(self) -> list[StepSamples]:
        """Return the steps still open, lowest first."""
        return [self._given_back(step) for step in sorted(self._open)]

    def _count_unused(self, sample: Sample, first: Sample | None) -> None:
        self.unused["late" if first is None else "repeated" if first == sample else "contradicting"] += 1
        if first is not None and first != sample:
            known = self.contradicted_from
            self.contradicted_from = sample.step if known is None else min(known, sample.step)

    def _given_back(self, step: int) -> StepSamples:
        known = self._open.pop(step)
        self.incomplete += known.keys() != self._fields
        self._newest = self._given[step] = StepSamples(step, **known)
        if len(self._given) > OPEN_STEPS:
            del self._given[next(iter(self._given))]
        return self._newest


class FrameAssembler:
    """Joins samples to whole frames; steps with a sample missing are counted and left out.

    Parameters
    ----------
    has_body : bool
        Whether a frame needs a body sample to be whole.
    """

    def __init__(self, has_body: bool) -> None:
        self._has_body = has_body
        self._steps = StepAssembler(frozenset(FIELDS.values()) - (set() if has_body else {"body"}))

    @property
    def incomplete(self) -> int:
        """How many steps were left out."""
        return self._steps.incomplete

    def add(self, sample: Sample) -> Frame | None:
        """Return the frame that this sample completes, if it does."""
        frames = [step.frame(self._has_body) for step in self._steps.add(sample)]
        return frames[-1] if frames else None
