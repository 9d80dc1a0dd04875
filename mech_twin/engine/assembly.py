"""Frames put together again from samples that come one by one, from topics or from a bag."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from mech_twin.samples import BodySample, ForceSample, Frame, LinkageSample, MotorSample, Sample

OPEN_STEPS = 64


class FrameAssembler:
    """Joins the samples of one step to a frame.

    Parameters
    ----------
    has_body : bool
        Whether a frame needs a body sample to be whole.
    """

    def __init__(self, has_body: bool) -> None:
        self.incomplete = 0
        self._wanted = 4 if has_body else 3
        self._open: OrderedDict[int, dict[type, Any]] = OrderedDict()
        self._last = -1

    def add(self, sample: Sample) -> Frame | None:
        """Return the frame this sample completes, if it does; a repeated step is passed over."""
        if sample.step <= self._last:
            return None
        parts = self._open.setdefault(sample.step, {})
        parts.setdefault(type(sample), sample)
        if len(parts) < self._wanted:
            if len(self._open) > OPEN_STEPS:
                self._open.popitem(last=False)
                self.incomplete += 1
            return None
        del self._open[sample.step]
        self._last = sample.step
        return Frame(parts[LinkageSample], parts[MotorSample], parts[ForceSample], parts.get(BodySample))
