# SPDX-License-Identifier: Apache-2.0
"""Objects that are closed where their context ends."""

from typing import Self


class Closing:
    """A context manager of itself, closed at the end of the context."""

    def close(self) -> None:
        """End the work, and release what it holds."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
