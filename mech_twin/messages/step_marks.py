# SPDX-License-Identifier: Apache-2.0
"""What a publishing node adds to a step message: its own number, and the configuration the sample was computed with."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.messages.joint_state_cdr import AnyStep
from mech_twin.messages.step_message import REVISION, SOURCE, Row

ANONYMOUS = 0.0  # the source of who does not sign


def marked(message: AnyStep, name: str, absent: float) -> float:
    """Return a number a node has added to a step message, or ``absent`` if it has not."""
    names = message.name
    return float(message.position[names.index(name)]) if name in names else absent


def source(message: AnyStep) -> float:
    """Return the number the publishing node signs with; 0 if it does not."""
    names = message.name
    return float(message.position[-1]) if names and names[-1] == SOURCE else marked(message, SOURCE, ANONYMOUS)


def revision(message: AnyStep) -> int:
    """Return how many parameter changes the sample was computed with; 0 if the message does not say."""
    return int(marked(message, REVISION, 0.0))


class ConfigurationMark(NamedTuple):
    """The configuration a sample was computed with: its revision, and the source of the node that described it."""

    revision: int = 0
    source: float = 0.0


def configuration_mark(message: AnyStep) -> ConfigurationMark:
    """Return which configuration the sample was computed with; revision 0 if the message does not say."""
    names = message.name
    if len(names) > 1 and names[-2] == REVISION:  # where the twin's own nodes write it
        return ConfigurationMark(int(message.position[-2]), float(message.velocity[-2]))
    if REVISION not in names:
        return ConfigurationMark()
    row = names.index(REVISION)
    return ConfigurationMark(int(message.position[row]), float(message.velocity[row]))


def revision_row(number: int, source: float = 0.0) -> Row:
    """Return the row that says which configuration a sample was computed with."""
    return Row(REVISION, float(number), source)
