# SPDX-License-Identifier: Apache-2.0
"""``mech-twin run``: runs the nodes of a machine for a duration or until a signal."""

from __future__ import annotations

import math
import os
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pydantic import ValidationError

from mech_twin.cli.console import print_json, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.live_view import WEB_VIEWS, check_view, hold_view, opened_view
from mech_twin.cli.run_summary import show_events, show_numbers
from mech_twin.configuration_tree import configuration_tree
from mech_twin.nodes.domain import DISCOVERY, OTHER_HOSTS, settle_domain
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import RUN_GROUP, assignments, machine_parameters, run_group
from mech_twin.quantity import Parameters
from mech_twin.recording.output_directory import check_recording_directory, remove_recording
from mech_twin.studies.simulation import event_record

if TYPE_CHECKING:
    from mech_twin.nodes.composition import Outcome
    from mech_twin.nodes.options import RunOptions

PACES = ("realtime", "max")


class RunRequest(NamedTuple):
    """Arguments of the command."""

    machine: str
    pace: str | None
    duration_s: float | None
    record: Path | str | None
    view: str
    view_port: int
    processes: bool
    config: Path | None
    settings: list[str]
    as_json: bool
    open_to_other_hosts: bool = False
    namespace: str | None = None
    force: bool = False
    everything: bool = False
    hold: bool = False


def run_machine(request: RunRequest) -> None:
    """Run the nodes and, at the end, print the metrics of the run."""
    _check(request)
    parameters = machine_parameters(request.machine, request.config, assignments(request.settings))
    directory = _recording_directory(request)
    if directory is not None:
        check_recording_directory(directory, force=request.force)
    options = run_options(request, recorder=directory is not None, viewer=request.view != "none")
    with ExitStack() as stack:
        view = opened_view(request.view, request.view_port, stack, open_to_other_hosts=request.open_to_other_hosts)
        outcome = _run(request, parameters, options, directory, view.destination)
        _write(request, parameters, outcome, directory)
        if request.hold:
            hold_view(view.page)


def _run(
    request: RunRequest, parameters: Parameters, options: RunOptions, directory: Path | None, destination: str | None
) -> Outcome:
    discovery = settle_domain(request.open_to_other_hosts)
    if request.open_to_other_hosts:
        say(_exposure_warning(discovery))
    from mech_twin.nodes.composition import run_in_process
    from mech_twin.nodes.multi_process import run_processes

    if directory is not None:
        remove_recording(directory)
        say(f"recording to {directory}")
    say("starting (the first run compiles the numerical kernels, which takes up to a minute)")
    run_nodes = run_processes if request.processes else run_in_process
    return run_nodes(request.machine, parameters, options, directory, destination, request.namespace)


def run_options(request: RunRequest, *, recorder: bool, viewer: bool) -> RunOptions:
    """Return how the nodes are run: what an option says, else what the group ``run`` of the configuration says.

    Raises
    ------
    ConfigurationError
        If the group does not validate.
    """
    from mech_twin.nodes.options import RunOptions

    configured = {"pace": PACES[0]} | run_group(request.machine, request.config, assignments(request.settings))
    said = {"pace": request.pace, "duration_s": request.duration_s}
    asked = {name: value for name, value in said.items() if value is not None}
    try:
        RunOptions.model_validate(configured)  # what an option replaces is no reason to let it pass
        return RunOptions.model_validate({**configured, **asked, "recorder": recorder, "viewer": viewer})
    except ValidationError as error:
        raise refusal(f"{RUN_GROUP} group", error, RunOptions) from error


def _exposure_warning(discovery: str) -> str:
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    if discovery != OTHER_HOSTS:
        return f"topics: not exposed, because {DISCOVERY}={discovery} is set and is not overridden (domain {domain})"
    return (
        f"topics: OPEN TO OTHER HOSTS, without authentication: ROS domain {domain}, discovery range {discovery}; "
        "anyone on the same network can read all topics, send commands and set parameters"
    )


def _check(request: RunRequest) -> None:
    if request.pace is not None and request.pace not in PACES:
        raise CommandError(f"--pace {request.pace}: expected {' or '.join(PACES)}")
    if request.duration_s is not None and not math.isfinite(request.duration_s):
        raise CommandError(f"--duration {request.duration_s}: expected a finite number of seconds")
    from mech_twin.nodes.namespace import run_namespace

    run_namespace(request.machine, request.namespace)
    check_view(request.view, request.view_port, force=request.force)
    if request.hold and request.view not in WEB_VIEWS:
        raise CommandError(f"--hold: expected --view web, which it keeps open; found --view {request.view}")


def _recording_directory(request: RunRequest) -> Path | None:
    if request.record is None:
        return None
    if isinstance(request.record, Path):
        return request.record
    return Path("recordings") / f"{request.machine}-{datetime.now():%Y%m%d-%H%M%S}"


def _write(request: RunRequest, parameters: Parameters, outcome: Outcome, directory: Path | None) -> None:
    numbers = outcome.metrics.numbers()
    if not request.as_json:
        design = set(numbers) - set(outcome.metrics.running_numbers())
        show_numbers(f"{request.machine}: metrics of the run", numbers, design, everything=request.everything)
        show_events(tuple(outcome.metrics.events), everything=request.everything)
        if directory is not None:
            say(f"recorded in {directory}; `mech-twin view {directory}` shows it again")
        return
    print_json(
        {
            "machine": request.machine,
            "config": configuration_tree(parameters),
            "summary": numbers,
            "events": [event_record(event) for event in outcome.metrics.events],
            "recording": None if directory is None else str(directory),
            "messages_sent": outcome.sent,
            "messages_recorded": outcome.recorded,
        }
    )
