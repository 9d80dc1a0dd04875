# SPDX-License-Identifier: Apache-2.0
"""``mech-twin reproduce``."""

from __future__ import annotations

from pathlib import Path

from mech_twin.cli.console import busy, print_json, progress, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.reproduce_output import show_rows, show_wide_rows, write_csv
from mech_twin.cli.verbs import ReproduceVerb
from mech_twin.files.output_file import check_output_directory
from mech_twin.process.dependencies import require_extra

WRITERS = {"narrow": show_rows, "wide": show_wide_rows, "csv": write_csv}


def reproduce_machines(asked: ReproduceVerb) -> None:
    """Write the comparison with the sources and, if asked, their figures; exit code 1 where a gated row fails."""
    from mech_twin.parameters.load import assignments, machine_parameters
    from mech_twin.studies import reproduce
    from mech_twin.studies.reproduction import all_hold, machines_with_published_values

    machine, figures, config, settings = asked.machine, asked.figures, asked.config, asked.settings
    if figures is not None:
        check_output_directory(figures, force=asked.force)
        require_extra("plots")
    parameters = None
    if config is not None or settings:
        if machine is None:
            raise CommandError("--config and --set change one machine: name it before them")
        parameters = machine_parameters(machine, config, assignments(settings))
    with busy("computing published values"):
        rows = reproduce(machine, parameters)
    files: list[Path] = []
    if figures is not None:
        from mech_twin.studies import draw_figures

        machines = machines_with_published_values() if machine is None else (machine,)
        with progress(machines, len(machines), "drawing") as counted:
            for name in counted:
                files += draw_figures(name, figures, parameters)
    hold = all_hold(rows)
    if asked.as_json:
        counts = {verdict: sum(row.verdict == verdict for row in rows) for verdict in {row.verdict for row in rows}}
        document = {
            "machine": machine or "all",
            "all_gated_hold": hold,
            "verdicts": counts,
            "rows": [row.record() for row in rows],
            "figures": [str(file) for file in files],
        }
        print_json(document)
    else:
        WRITERS[asked.form](rows)
        for file in files:
            say(f"wrote {file}")
    if not hold:
        failing = sum(not row.holds for row in rows)
        say(f"mech-twin: {failing} of {sum(row.gated for row in rows)} gated rows do not hold")
        raise SystemExit(1)
