# SPDX-License-Identifier: Apache-2.0
"""``mech-twin foxglove``: a running machine for Foxglove, without a bridge."""

from __future__ import annotations

from mech_twin.cli.console import say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.verbs import FoxgloveVerb
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.process.dependencies import require_modules
from mech_twin.process.stop_signal import StopSignal


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
    try:
        with StopSignal() as stop:
            server.serve(lambda: stop.asked)
    finally:
        server.close()
