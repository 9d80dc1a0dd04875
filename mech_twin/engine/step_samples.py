# SPDX-License-Identifier: Apache-2.0
"""The samples received for one step: a frame in which some may be missing, from recordings and topics."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.engine.trajectory import step_events
from mech_twin.samples import BodySample, Event, ForceSample, Frame, LinkageSample, MotorSample


class StepSamples(NamedTuple):
    """The samples of one step, None where there is none."""

    step: int
    linkage: LinkageSample | None = None
    motor: MotorSample | None = None
    forces: ForceSample | None = None
    body: BodySample | None = None

    @property
    def events(self) -> tuple[Event, ...]:
        """The events of the step, in time order."""
        return step_events(self.linkage, self.body)

    def frame(self, has_body: bool) -> Frame | None:
        """Return the whole frame, or None if a sample of it is missing."""
        if self.linkage is None or self.motor is None or self.forces is None or (has_body and self.body is None):
            return None
        return Frame(self.linkage, self.motor, self.forces, self.body)
