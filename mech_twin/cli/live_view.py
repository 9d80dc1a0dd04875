# SPDX-License-Identifier: Apache-2.0
"""The option ``--view`` of what runs live - a page in the browser, a file, or nothing - and the bench without a run."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.cli.console import CommandError, say
from mech_twin.cli.machines import shipped_pages
from mech_twin.cli.verbs import BenchVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import check_output_file
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.load import PAGE
from mech_twin.process.dependencies import require_modules
from mech_twin.process.interruption import StopSignal, end_with_parent
from mech_twin.studies.run_comparison import changed_settings
from mech_twin.view.bench.link import BEGUN_BY, BenchLink

WEB_VIEW = "web"
NO_VIEW = "none"
LOOK_S = 0.1
RUN_ORDERS = ("start", "stop", "reset", "pause", "step", "speed", "change")
MONITOR_ORDERS, ADVISOR_ORDERS = ("acknowledge", "shelve"), ("accept", "reject")
IDENTIFIER_ORDERS = ("identify", "take-over")


class OpenedView(NamedTuple):
    """Where the view is sent - a bench started here, a file, or nowhere - the address of its page, and a link to it."""

    destination: str | None
    page: str = ""
    link: BenchLink | None = None

    def tell(self, kind: str, content: Mapping[str, Any]) -> None:
        """Tell the page something, if there is one."""
        if self.link is not None:
            self.link.tell(kind, content)


def compile_status(link: BenchLink, most: int) -> Callable[[str, int], None]:
    """Return a function that shows on the page which of at most ``most`` kernels is compiled (0: unknown)."""
    begun_s: float | None = None

    def compiling(kernel: str, count: int) -> None:
        nonlocal begun_s
        now_s = time.monotonic()
        begun_s = now_s if begun_s is None else begun_s
        name, of = kernel.rpartition(".")[2], f" of at most {most}" if count <= most else ""
        number = f"number {count}{of} ({name}), {now_s - begun_s:.0f} s"
        link.tell("status", {"text": f"compiling kernels for this processor, once: {number}"})

    return compiling


def check_view(view: str, port: int, *, force: bool) -> None:
    """Raise where it is no view, has no page for the port, or its file exists and may not be overwritten."""
    if view not in (WEB_VIEW, NO_VIEW) and not view.endswith(".rrd"):
        raise CommandError(f"--view {view}: expected web, none or a file NAME.rrd")
    if port and view != WEB_VIEW:
        raise CommandError(f"--view-port {port}: expected --view {WEB_VIEW} beside it")
    if view.endswith(".rrd"):
        check_output_file(Path(view), force=force)


def opened_view(
    view: str, port: int, stack: ExitStack, *, open_to_other_hosts: bool = False, kernels: int = 0
) -> OpenedView:
    """Return the view with its bench started; the stack closes it."""
    if view == NO_VIEW:
        return OpenedView(None)
    if view != WEB_VIEW:
        require_modules("rerun", "pyarrow")
        return OpenedView(view)
    found = opened_bench(port, stack, open_to_other_hosts=open_to_other_hosts)
    assert found.link is not None
    found.tell("status", {"text": "loading"})
    from mech_twin.kernels.cache import on_compile  # loads the compiler: the page is there by now

    stack.callback(on_compile(compile_status(found.link, kernels)))
    return found


def opened_bench(
    port: int, stack: ExitStack, *, open_to_other_hosts: bool = False, history_bytes: int = 32 << 20
) -> OpenedView:
    """Start a bench, say its address, and leave it to the stack; or return the bench that has begun this command."""
    require_modules("aiohttp")
    if (place := os.environ.get(BEGUN_BY)) is not None:
        end_with_parent(os.getppid())
        return OpenedView(place, "", stack.enter_context(BenchLink(place)))
    from mech_twin.view.bench.started import StartedBench

    bench = stack.enter_context(
        StartedBench(port or None, open_to_other_hosts=open_to_other_hosts, history_bytes=history_bytes, announce=say)
    )
    say(f"view: {bench.url}")
    return OpenedView(bench.place, bench.url, stack.enter_context(BenchLink(bench.place)))


def machine_message(name: str, namespace: str, orders: Sequence[str], parameters: Parameters | None) -> dict[str, Any]:
    """Return what the page needs for commands: namespace, orders, and live parameters of the machine."""
    from mech_twin.nodes.exchange.parameter_bridge import live_keys

    keys = [] if parameters is None else live_keys(parameters)
    tree = None if parameters is None else configuration_tree(parameters)
    description = {"name": name, "namespace": namespace, "orders": list(orders), "parameters": keys}
    return description | {"configuration": tree, "settings": [] if tree is None else changed_settings(name, tree)}


def hold_view(page: str) -> None:
    """Keep the view open until a signal."""
    say(f"the view stays open until Ctrl-C: {page}")
    with StopSignal() as stop:
        while not stop.asked:
            time.sleep(LOOK_S)


def open_bench(request: BenchVerb) -> None:
    """Open the bench on a folder of recordings until stopped."""
    folder = request.folder
    if not folder.is_dir():
        raise CommandError(f"{folder}: expected a directory of recordings")
    require_modules("aiohttp")
    settle_domain()
    from mech_twin.view.bench.started import StartedBench

    machines = [*(name for name in CATALOGUE if name != PAGE.name), *map(str, shipped_pages().values())]
    hall = {"folder": str(folder.resolve()), "machines": machines}
    with StartedBench(request.port or None, hall=hall, history_bytes=512 << 20, announce=say) as bench:
        say(f"view: {bench.url}")
        hold_view(bench.url)
