# SPDX-License-Identifier: Apache-2.0
"""The breaker's two excitations on one picture, from its installed configuration.

python benchmarks/breaker_excitations.py docs/images
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mech_twin.capabilities.plots import house_style, written
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.published import compared_pulses, excitation_picture, pulse_summary
from mech_twin.parameters.load import machine_parameters


def main() -> None:
    """Write the picture and print the numbers that go with it."""
    asked = argparse.ArgumentParser(description="the breaker's two excitations on one picture")
    asked.add_argument("directory", type=Path)
    directory = asked.parse_args().directory
    parameters = machine_parameters("mb10_breaker")
    if not isinstance(parameters, BreakerParameters):
        raise TypeError(f"expected the breaker's parameters, got {type(parameters).__name__}")
    assumed, computed = compared_pulses(parameters)
    with house_style():
        picture = excitation_picture(assumed, computed)
    for file in written(picture, directory):
        if file.suffix == ".svg":
            file.unlink()
    for line in (picture.caption, pulse_summary("assumed", assumed), pulse_summary("computed", computed)):
        print(line)


if __name__ == "__main__":
    main()
