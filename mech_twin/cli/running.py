# SPDX-License-Identifier: Apache-2.0
"""``mech-twin tell`` and ``foxglove``: a running machine is told something, or served to Foxglove."""

from __future__ import annotations

from contextlib import closing

from mech_twin.cli.console import say, say_result
from mech_twin.cli.failure import CommandError
from mech_twin.cli.verbs import FoxgloveVerb, TellVerb
from mech_twin.nodes.run.domain import UnansweredError, settle_domain
from mech_twin.parameters.load import assignments
from mech_twin.process.dependencies import require_modules
from mech_twin.process.stop_signal import StopSignal


def tell_nodes(asked: TellVerb) -> None:
    """Tell the nodes and print what they answer."""
    target, what, fault = asked.target, asked.what, asked.fault
    settle_domain()
    from mech_twin.nodes.run.telling import ORDERS, tell

    order = None if "=" in what[0] else what[0]
    if order is not None and (order not in ORDERS or len(what) > 1):
        raise CommandError(f"tell {' '.join(what)}: expected KEY=VALUE ..., or one of {', '.join(ORDERS)}")
    if fault is not None and (order is None or not ORDERS[order].of_a_fault):
        raise CommandError("--fault goes with acknowledge and shelve")
    try:
        say_result(tell(target, order, assignments(what) if order is None else {}, fault, asked.wait_s))
    except UnansweredError as error:
        raise CommandError(f"tell {target} {error}") from error


def serve_foxglove(asked: FoxgloveVerb) -> None:
    """Serve the topics of a machine until stopped."""
    require_modules("foxglove")
    settle_domain()
    from mech_twin.nodes.run.foxglove_server import FoxgloveServer

    try:
        server = FoxgloveServer(asked.target, asked.port, commands=asked.commands)
    except OSError as error:
        raise CommandError(f"foxglove: {error}; choose another one with --port") from error
    allowed = (
        "any page of a browser on this machine may command it"
        if asked.commands
        else "clients watch; --commands lets them act"
    )
    say(f"foxglove: ws://127.0.0.1:{server.port} ({allowed})")
    with StopSignal() as stop, closing(server):
        server.serve(lambda: stop.asked)
