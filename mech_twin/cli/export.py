# SPDX-License-Identifier: Apache-2.0
"""``mech-twin export fmu``: a machine as a functional mock-up unit, for the tools of others."""

from __future__ import annotations

from pathlib import Path

from mech_twin.cli.console import busy, print_json, say_result
from mech_twin.cli.verbs import FmuVerb
from mech_twin.fmi.export import LINUX, WINDOWS, export_fmu
from mech_twin.fmi.unit_variables import unit_name
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine


def export_unit(asked: FmuVerb) -> None:
    """Write the unit, and say what an importer sees of it."""
    built = built_machine(asked.machine, asked.config, assignments(asked.settings))
    fmi, file = asked.fmi, asked.out or Path(f"{unit_name(built)}.fmu")
    platforms = (LINUX, WINDOWS) if asked.windows else (LINUX,)
    with busy("compiling the unit"):
        written = export_fmu(built, file, fmi, platforms, force=asked.force)
    if asked.as_json:
        print_json(
            {
                "machine": unit_name(built),
                "file": str(file),
                "fmi": fmi,
                "platforms": [platform.folders[fmi - 2] for platform in platforms],
                "inputs": [v.name for v in written.variables if v.causality == "input"],
                "outputs": [v.name for v in written.variables if v.causality == "output"],
                "parameters": list(written.parameters),
            }
        )
        return
    outputs = sum(v.causality == "output" for v in written.variables)
    keys = ", ".join(written.parameters) or "none"
    say_result(f"{file}: FMI {fmi}.0 co-simulation of {unit_name(built)}, {outputs} outputs")
    say_result(f"keys that an importer may set: {keys}; for others export anew with --set")
