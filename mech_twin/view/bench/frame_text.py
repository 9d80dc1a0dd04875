# SPDX-License-Identifier: Apache-2.0
"""Converts a frame, the complete state of a run at a step, to plain lists for JSON and back."""

from __future__ import annotations

from typing import Any, TypeVar

from mech_twin.samples import BodySample, ForceSample, Frame, LinkageSample, MotorSample, Named, Wrench

Sample = TypeVar("Sample", MotorSample, LinkageSample, ForceSample, BodySample)
NAMED = ("memory", "residuals", "quantities")
LEFT_OUT = ("events", "loads")  # of the step that ends here; not needed to continue


def listed(frame: Frame) -> dict[str, Any]:
    """Return the samples of a frame by role, without events."""
    roles = {name: sample for name, sample in frame._asdict().items() if sample is not None}
    return {
        name: {field: value for field, value in sample._asdict().items() if field not in LEFT_OUT}
        for name, sample in roles.items()
    }


def framed(content: dict[str, Any]) -> Frame:
    """Return the frame made of the lists of `listed`."""
    return Frame(
        linkage=_sample(LinkageSample, content["linkage"]),
        motor=_sample(MotorSample, content["motor"]),
        forces=_sample(ForceSample, content["forces"]),
        body=_sample(BodySample, content["body"]) if "body" in content else None,
    )


def _sample(kind: type[Sample], content: dict[str, Any]) -> Sample:
    fields: dict[str, Any] = {}
    for name, value in content.items():
        if name in NAMED:
            fields[name] = Named(*(tuple(part) for part in value))
        elif name == "wrenches":
            fields[name] = tuple(Wrench(*each) for each in value)
        else:
            fields[name] = tuple(value) if isinstance(value, list) else value
    return kind(**fields)
