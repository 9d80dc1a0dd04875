# SPDX-License-Identifier: Apache-2.0
"""``mech-twin run``, ``tell``, ``foxglove``: nodes of a machine run, are told something, are served to Foxglove."""

from __future__ import annotations

import os
from contextlib import ExitStack, closing
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from mech_twin.cli.console import CommandError, print_json, report_losses, say, say_result
from mech_twin.cli.live_view import RUN_ORDERS, WEB_VIEW, check_view, hold_view, machine_message, opened_view
from mech_twin.cli.run_summary import digits_note, say_consequences, show_events, show_numbers
from mech_twin.cli.verbs import FoxgloveVerb, RunVerb, TellVerb
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.nodes.run.domain import DISCOVERY, OTHER_HOSTS, UnansweredError, run_namespace, settle_domain
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import (
    PAGE,
    RUN_GROUP,
    assignments,
    catalogue_entry,
    is_page,
    machine_parameters,
    run_group,
)
from mech_twin.process.dependencies import require_modules
from mech_twin.process.interruption import StopSignal
from mech_twin.recording.bag_metadata import check_recording_directory, kept_until_replaced
from mech_twin.roles import own_name
from mech_twin.studies.simulation import event_record

if TYPE_CHECKING:
    from mech_twin.nodes.exchange.base_node import RunOptions
    from mech_twin.nodes.run.composition import Outcome
    from mech_twin.studies.simulation import RunMetrics


def run_machine(request: RunVerb) -> None:
    """Run the nodes and, at the end, print the metrics of the run."""
    settle_domain(request.open_to_other_hosts)  # before anything large is loaded: where memory runs out is not chosen
    run_namespace(PAGE.name if is_page(request.machine) else request.machine, request.namespace)
    check_view(request.view, request.view_port, force=request.force)
    if request.hold and request.view != WEB_VIEW:
        raise CommandError(f"--hold: expected --view web, which it keeps open; found --view {request.view}")
    require_modules("rclpy")  # before a view is opened
    parameters = request.parameters
    if is_page(request.machine):
        request.built  # noqa: B018 # refuses what cannot start
        request = _of_page(request, parameters)
    say_consequences(request.machine, request.config, request.settings)
    directory = None if request.no_record else request.record or _new_directory(request.machine)
    if directory is not None:
        check_recording_directory(directory, force=request.force)
    options = run_options(request, recorder=directory is not None, viewer=request.view != "none")
    with ExitStack() as stack:
        kernels, open_to = catalogue_entry(request.machine).kernels, request.open_to_other_hosts
        view = opened_view(request.view, request.view_port, stack, open_to_other_hosts=open_to, kernels=kernels)
        if view.link is not None:
            place = run_namespace(request.machine, request.namespace)
            view.tell("machine", machine_message(request.machine, place, RUN_ORDERS, parameters))
            view.tell("status", {"text": "starting the nodes, building the machine"})
        outcome = _run(request, parameters, options, directory, view.destination)
        view.tell("end", {"text": "the run is over" + ("" if directory is None else f"; recorded in {directory}")})
        _write(request, parameters, outcome, directory)
        remarks = catalogue_entry(request.machine).build(parameters).remarks(outcome.metrics.summary())
        say(*(f"warning: {remark}" for remark in remarks))
        report_losses(directory, known=() if options.snapshot_s else ended_early(directory, outcome.metrics))
        if request.hold:
            hold_view(view.page)


def ended_early(directory: Path | None, metrics: RunMetrics) -> list[str]:
    """Return a line where a recording ends before its run: no counter tells what all topics lack alike."""
    if directory is None or not directory.exists() or metrics.last is None:
        return []
    from mech_twin.nodes.roles.recorder_node import UNDER_WAY
    from mech_twin.recording.bag_reader import bag_info
    from mech_twin.recording.errors import BagError

    try:
        info = bag_info(directory)
    except BagError:  # `report_losses` says it
        return []
    end_s, last_s = (info.start_ns or 0) * 1e-9 + info.duration_s, metrics.last.linkage.time_s
    lagging = f"{directory}: ends at {end_s:.6g} s, the run at {last_s:.6g} s: the recorder did not keep up"
    return [lagging] if last_s - end_s > (UNDER_WAY + 0.5) * metrics.machine.coupling_step_s else []


def _of_page(request: RunVerb, parameters: Parameters) -> RunVerb:
    """Return the request for the machine that a page makes, in the namespace of the page's own name."""
    name = own_name(request.machine, parameters)
    config = request.config or Path(request.machine)
    record = request.record or _new_directory(name)
    return request.model_copy(
        update={"machine": PAGE.name, "config": config, "namespace": request.namespace or name, "record": record}
    )


def _run(
    request: RunVerb, parameters: Parameters, options: RunOptions, directory: Path | None, destination: str | None
) -> Outcome:
    discovery = settle_domain(request.open_to_other_hosts)
    if request.open_to_other_hosts:
        domain = f"domain {os.environ.get('ROS_DOMAIN_ID', '0')}"
        kept = f"not exposed, because {DISCOVERY}={discovery} is set and is not overridden ({domain})"
        opened = f"OPEN TO OTHER HOSTS, without authentication: ROS {domain}, discovery range {discovery}; "
        warning = "anyone on the same network can read all topics, send commands and set parameters"
        say(f"topics: {kept if discovery != OTHER_HOSTS else opened + warning}")
    from mech_twin.nodes.run.composition import run_in_process, run_processes

    if directory is not None:
        kept = f"the last {options.snapshot_s:g} s before each trigger or alarm " if options.snapshot_s else ""
        say(f"recording {kept}to {directory}")
    say("starting (the first run compiles the numerical kernels, which takes up to a minute)")
    run_nodes = run_processes if request.processes else run_in_process
    with kept_until_replaced(directory) as aside:
        say(*aside)
        return run_nodes(request.machine, parameters, options, directory, destination, request.namespace)


def run_options(request: RunVerb, *, recorder: bool, viewer: bool) -> RunOptions:
    """Return the options of the nodes: the command's, else those of the group ``run`` of the configuration."""
    from mech_twin.nodes.exchange.base_node import RunOptions

    configured = {"pace": "realtime"} | run_group(request.machine, request.config, assignments(request.settings))
    shared = RunOptions.model_fields.keys() & RunVerb.model_fields.keys()
    given = {name: value for name in shared if (value := getattr(request, name)) is not None}
    try:
        RunOptions.model_validate(configured)  # what an option replaces is no reason to let it pass
        return RunOptions.model_validate({**configured, **given, "recorder": recorder, "viewer": viewer})
    except ValidationError as error:
        raise refusal(f"{RUN_GROUP} group", error, RunOptions) from error


def _new_directory(name: str) -> Path:
    return Path("recordings") / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"


def _write(request: RunVerb, parameters: Parameters, outcome: Outcome, directory: Path | None) -> None:
    numbers = outcome.metrics.summary()
    if not request.as_json:
        design = set(numbers) - set(outcome.metrics.numbers())
        name = getattr(parameters, "name", request.machine)
        show_numbers(f"{name}: metrics of the run", numbers, design, everything=request.everything)
        say_result(digits_note(configuration_tree(parameters)["coupling"]["step_s"]))
        say(*filter(None, [outcome.metrics.since()]))
        counts = outcome.metrics.event_counts
        show_events(outcome.metrics.events, counts, numbers, everything=request.everything)
        if directory is not None and directory.exists():
            say(f"recorded in {directory}; `mech-twin view {directory}` shows it again")
        return
    events = [event_record(event) for event in outcome.metrics.events]
    head = {"machine": request.machine, "config": configuration_tree(parameters), "summary": numbers, "events": events}
    sent = {"recording": directory, "messages_sent": outcome.sent}
    print_json({**head, "event_counts": outcome.metrics.event_counts, **sent})


def _namespace_of(target: str) -> str:
    """Return the namespace of a machine's nodes, from its name, its page or the namespace itself."""
    if is_page(target):
        return own_name(target, machine_parameters(target))
    try:
        return run_namespace("", target)
    except ConfigurationError as error:
        raise CommandError(f"{target}: expected a machine, a page, or a namespace such as hall/plant_2") from error


def tell_nodes(request: TellVerb) -> None:
    """Tell the nodes and print what they answer."""
    settle_domain()
    from mech_twin.nodes.run.person_commands import ORDERS, tell

    target, what, fault = _namespace_of(request.target), request.what, request.fault
    order = None if "=" in what[0] else what[0]
    if order is not None and (order not in ORDERS or len(what) > 1):
        raise CommandError(f"tell {' '.join(what)}: expected KEY=VALUE ..., or one of {', '.join(ORDERS)}")
    if fault is not None and (order is None or not ORDERS[order].of_a_fault):
        raise CommandError("--fault goes with acknowledge and shelve")
    try:
        say_result(tell(target, order, assignments(what) if order is None else {}, fault, request.wait_s))
    except UnansweredError as error:
        raise CommandError(f"tell {request.target} {error}") from error


def serve_foxglove(request: FoxgloveVerb) -> None:
    """Serve the topics of a machine until stopped."""
    require_modules("foxglove")
    settle_domain()
    from mech_twin.nodes.run.foxglove_server import FoxgloveServer

    try:
        server = FoxgloveServer(_namespace_of(request.target), request.port, commands=request.commands)
    except OSError as error:
        raise CommandError(f"foxglove: {error}; choose another one with --port") from error
    watched = "clients watch; --commands lets them act"
    allowed = "any page of a browser on this machine may command it" if request.commands else watched
    say(f"foxglove: ws://127.0.0.1:{server.port} ({allowed})")
    absent = f"no node in {server.namespace} yet; does the machine run?"
    with StopSignal() as stop, closing(server):
        server.serve(lambda: stop.asked, absent=lambda: say(absent))
