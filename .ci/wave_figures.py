# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of docs/impact-waves.md: python .ci/wave_figures.py."""

from __future__ import annotations

from pathlib import Path

from mech_twin.capabilities.plots import house_style, written
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.plots import wave_pictures
from mech_twin.parameters.load import machine

IMAGES = Path(__file__).parents[1] / "docs" / "images"

if __name__ == "__main__":
    parameters = machine("mb10_breaker").parameters
    assert isinstance(parameters, BreakerParameters)
    with house_style():
        for picture in wave_pictures(parameters):
            vector, _ = written(picture, IMAGES)
            vector.unlink()
