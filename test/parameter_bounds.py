# SPDX-License-Identifier: Apache-2.0
"""What a parameter model accepts, and which of its numbers may change while a machine runs."""

from __future__ import annotations

import math
from typing import Any

from pydantic import ValidationError

from mech_twin.declarations.quantity import Parameters


def accepts(model: type[Parameters], valid: dict[str, Any], key: str, value: float) -> bool:
    """Return whether the model takes this value beside otherwise legal ones; a refusal must name the key."""
    try:
        model(**{**valid, key: value})
    except ValidationError as refusal:
        assert [error["loc"] for error in refusal.errors()] == [(key,)]
        return False
    return True


def has_range(model: type[Parameters], valid: dict[str, Any], key: str, smallest: float, largest: float) -> bool:
    """Return whether a number may be all from the smallest to the largest, and not the next one on either side."""
    inside = accepts(model, valid, key, smallest) and accepts(model, valid, key, largest)
    below, above = math.nextafter(smallest, -math.inf), math.nextafter(largest, math.inf)
    return inside and not accepts(model, valid, key, below) and not accepts(model, valid, key, above)


def live_names(model: type[Parameters]) -> set[str]:
    """Return the numbers of a model that may change while the machine runs."""
    extras = {name: field.json_schema_extra for name, field in model.model_fields.items()}
    return {name for name, extra in extras.items() if isinstance(extra, dict) and extra["live"]}
