# SPDX-License-Identifier: Apache-2.0
"""The configurations that were described, by who described them: a role adopts the one its questions name.  No ROS."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.messages.step_marks import ConfigurationMark
from mech_twin.parameters.load import Description

REMEMBERED_SOURCES = 8


class StoredDescription(NamedTuple):
    """A described configuration, and the text it came as."""

    content: Description
    text: str

    @property
    def mark(self) -> ConfigurationMark:
        """What the step messages computed with it say."""
        return ConfigurationMark(self.content.revision, self.content.source)


class DescriptionStore:
    """The newest configuration of each of the last few sources."""

    def __init__(self) -> None:
        self._by_source: dict[float, StoredDescription] = {}

    def add(self, content: Description, text: str) -> None:
        """Keep a description, unless its source has described a later revision."""
        known = self._by_source.pop(content.source, None)
        offered = StoredDescription(content, text)
        newest = known if known is not None and known.content.revision > content.revision else offered
        self._by_source[content.source] = newest
        while len(self._by_source) > REMEMBERED_SOURCES:
            del self._by_source[next(iter(self._by_source))]

    def find(self, wanted: ConfigurationMark) -> StoredDescription | None:
        """Return the configuration a question names, or a later one of the same source; None if it is not there yet."""
        known = self._by_source.get(wanted.source)
        return known if known is not None and known.content.revision >= wanted.revision else None
