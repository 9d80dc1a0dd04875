# SPDX-License-Identifier: Apache-2.0
"""Statistics of the last cycles or blows of a run."""

from __future__ import annotations

from collections.abc import Sequence

LAST = 20  # cycles, or blows, that are used


def over_last(records: Sequence[dict[str, float]], prefix: str = "steady_") -> dict[str, float]:
    """Return each metric that all records have: extreme if its name has smallest, largest or peak, else mean."""
    found = {}
    for name in records[-1]:
        values = [record[name] for record in records if name in record]
        if len(values) < len(records):
            continue
        if "smallest" in name:
            found[f"{prefix}{name}"] = min(values)
        elif "largest" in name or "peak" in name:
            found[f"{prefix}{name}"] = max(values)
        else:
            found[f"{prefix}{name}"] = sum(values) / len(values)
    return found
