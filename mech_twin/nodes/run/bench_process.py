# SPDX-License-Identifier: Apache-2.0
"""The bench as a process of its own: the page's server, a node that forwards its orders, and trials of other values.

It gets its configuration on standard input, and writes its address to standard output: one line of JSON each way.
"""

import asyncio
import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from typing import Any

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree, tree_from_flat
from mech_twin.errors import MotionError
from mech_twin.nodes.run.bench_hall import DOWNLOAD, LIST, OPEN, OVERLAY, RUN, SALVAGE, Hall
from mech_twin.process.interruption import end_with_parent
from mech_twin.studies.spreading import BesideProcess
from mech_twin.view.bench.bench_page import OrderError
from mech_twin.view.bench.link import FEED, PREFIX
from mech_twin.view.bench.server import Bench

SPAN_S = 0.3  # length of a roll-out in machine time: three blows of the breaker


class Trials:
    """Predictions (roll-outs) of one machine in a process of their own, one at a time.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    configuration : mapping
        Its complete configuration.
    """

    def __init__(self, name: str, configuration: Mapping[str, Any]) -> None:
        self._name, self._configuration = name, dict(configuration)
        self._beside: BesideProcess | None = None
        self._turn = asyncio.Lock()
        self.frame: dict[str, Any] | None = None

    def changed(self, key: str, value: Any) -> list[list[str]]:
        """Adopt a changed live parameter; return the settings that now differ from the installed ones."""
        from mech_twin.studies.run_comparison import changed_settings

        self._configuration = merged_tree(self._configuration, tree_from_flat({key: value}))
        return changed_settings(self._name, self._configuration)

    async def tried(self, values: Mapping[str, Any]) -> str:
        """Return curves and cards of the near future with these values, or why there are none.

        Raises
        ------
        OrderError
            If nothing runs yet, or the roll-out process has ended.
        """
        if self.frame is None:
            raise OrderError("nothing runs yet")
        try:
            tree = merged_tree(self._configuration, tree_from_flat(dict(values)))
        except ConfigurationError as error:
            raise OrderError(str(error)) from error
        async with self._turn:
            self._beside = self._beside or BesideProcess(priority=0)
            trial = self._beside.submit(rolled_out, self._name, tree, self.frame)
            try:
                answer = await asyncio.wrap_future(trial)
            except (ConfigurationError, MotionError) as error:
                answer = {"refused": str(error)}
            except BrokenProcessPool as error:
                raise OrderError("the trial was ended") from error
        return json.dumps({"kind": "ghost", "values": values, **answer}, separators=(",", ":"))

    async def close(self) -> None:
        """End the process."""
        if self._beside is not None:
            for trial in active_children():
                trial.kill()
            self._beside.end()


def rolled_out(name: str, tree: dict[str, Any], content: dict[str, Any]) -> dict[str, Any]:
    """Return the curves and cards of a machine's near future from a frame on, for the page."""
    from mech_twin.engine.run import continued
    from mech_twin.engine.trajectory import frame_events
    from mech_twin.parameters.load import catalogue_entry, validated
    from mech_twin.view.annotations import Banner
    from mech_twin.view.bench.picture import packed_curves
    from mech_twin.view.bench.scene import framed
    from mech_twin.view.run_scene import RoleCurves
    from mech_twin.view.sending import LIVE

    entry = catalogue_entry(name)
    machine = entry.build(validated(entry, tree, "trial"))
    begin = framed(content)
    roles = RoleCurves(frozenset() if machine.mechanism is None else machine.mechanism.sliding_joints)
    banner = Banner(machine.mechanism, *([] if machine.blow_energy is None else [machine.blow_energy]))
    banner.watch(machine)
    asked = begin.motor.command if begin.motor.asked is None else begin.motor.asked
    for frame in continued(machine, begin, SPAN_S, asked):
        roles.add(frame)
        banner.add(frame)
        for event in frame_events(frame):
            banner.strike(event)
    return {
        "from_s": begin.linkage.time_s,
        "to_s": begin.linkage.time_s + SPAN_S,
        "curves": packed_curves(roles.taken(LIVE)),
        "cards": banner.cards(),
    }


SERVICE_S = 10.0  # time limit for a service to be discovered; on a busy computer a machine is shown seconds before
HALL_ORDERS = (OPEN, OVERLAY, RUN, SALVAGE, DOWNLOAD, LIST)
Answer = Future[tuple[str, bool]]  # of a machine to an order, and whether it succeeded
SPEED, CHANGE, PAUSE, GO_ON, IDENTIFY = "speed", "change", "pause", "go-on", "identify"


class Orders(threading.Thread):
    """A thread that executes the orders of a bench one by one, through the services of the running machine.

    Parameters
    ----------
    namespace : str
        Namespace of the machine.
    changed : callable
        Called with name and value of each live parameter that changes, whichever node or client changed it.
    paused : callable
        Called with whether the run is paused, whoever paused it.
    """

    def __init__(self, namespace: str, changed: Callable[[str, Any], None], paused: Callable[[bool], None]) -> None:
        super().__init__(daemon=True, name="orders")
        self._namespace, self._changed, self._paused = namespace, changed, paused
        self._asked: queue.Queue[tuple[Mapping[str, Any], Answer]] = queue.Queue()
        self._is_over = False

    def ask(self, message: Mapping[str, Any]) -> Answer:
        """Queue an order."""
        answer = Answer()
        answer.set_running_or_notify_cancel()  # a page that has gone cancels no order
        self._asked.put((message, answer))
        return answer

    def close(self) -> None:
        """Refuse the orders that are not carried out yet, and end."""
        self._is_over = True

    def run(self) -> None:
        """Execute orders until closed."""
        from mech_twin.nodes.run.person_commands import Teller

        with Teller(self._namespace, SERVICE_S, lambda: self._is_over) as teller:
            teller.watch_parameters(self._changed)
            teller.watch_pause(self._paused)
            while not self._is_over or not self._asked.empty():
                teller.serve_until(lambda: self._is_over or not self._asked.empty())
                while not self._asked.empty():
                    message, answer = self._asked.get()
                    answer.set_result(carried_out(teller, message))


def carried_out(teller: Any, message: Mapping[str, Any]) -> tuple[str, bool]:
    """Return the machine's answer to an order, and whether it succeeded."""
    from mech_twin.nodes.run.domain import UnansweredError
    from mech_twin.nodes.run.person_commands import ORDERS

    name, values = message["name"], message.get("values", {})
    carry = {
        SPEED: lambda: teller.set_speed(float(values["share"])),
        CHANGE: lambda: teller.change(values),
        PAUSE: lambda: teller.pause(True),
        GO_ON: lambda: teller.pause(False),
    } | {order: partial(teller.order, order, message.get("fault")) for order in ORDERS if order != PAUSE}
    carry[IDENTIFY] = lambda: _identified(teller, values)
    if name not in carry or (name == CHANGE and not values):
        return f"{name}: expected one of {', '.join(carry)}", False
    try:
        return carry[name](), True
    except UnansweredError as error:
        return str(error), False
    except (KeyError, ValueError, TypeError):
        return f"{name}: expected a number", False


def _identified(teller: Any, values: Mapping[str, Any]) -> str:
    """Request a fit of the last seconds."""
    if "span_s" in values:
        teller.change({"span_s": float(values["span_s"])}, "identifier")
    return str(teller.order(IDENTIFY))


class BenchProcess:
    """Web server, thread of orders, trials and start page of a bench."""

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._settings = settings
        self._orders: Orders | None = None
        self._trials: Trials | None = None
        self._is_paused = False
        self._live: set[str] = set()
        self._loop = asyncio.get_running_loop()
        self.bench = Bench(self._obey, others=settings["others"], history_bytes=settings["history_bytes"])
        self.bench.on_machine = self._know
        self._hall: Hall | None = None
        if settings.get("hall"):
            place = f"{PREFIX}{Path(settings['folder']) / FEED}"
            shown = Path(settings["hall"]["folder"]), settings["hall"]["machines"], place
            self._hall = Hall(*shown, self._clear, self.bench.tell, self.bench.offer)

    async def serve(self) -> None:
        """Serve until SIGTERM or SIGINT."""
        over = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            self._loop.add_signal_handler(number, over.set)
        try:
            await self.bench.start(self._settings["port"], Path(self._settings["folder"]) / FEED)
        except OSError as error:
            why = "is busy" if error.errno == 98 else f"cannot be used ({os.strerror(error.errno or 0)})"
            _say({"error": f"web port {self._settings['port']} {why}; choose another one"})
            return
        _say({"port": self.bench.port, "token": self.bench.token})
        if self._hall is not None:
            await self._hall.look()
        await over.wait()
        if self._hall is not None:
            await self._hall.close()
        await self.bench.stop()
        await self._let_go()

    async def _let_go(self) -> None:
        """Stop forwarding orders to the machine that ran."""
        trials, orders, self._trials, self._orders = self._trials, self._orders, None, None
        if trials is not None:
            await trials.close()
        if orders is not None:
            orders.close()
            await asyncio.to_thread(orders.join)  # a process has one context of ROS: the next thread needs it

    async def _clear(self) -> None:
        """Clear the machine that ran, after its last message."""
        await self._let_go()
        await self.bench.begin_anew()

    def _know(self, machine: Mapping[str, Any]) -> None:
        """Start forwarding orders, if the machine accepts any."""
        if self._orders is None and machine.get("namespace"):
            self._is_paused = False
            self._orders = Orders(machine["namespace"], self._changed, self._paused)
            self._orders.start()
        self._live = {parameter["name"] for parameter in machine.get("parameters", [])}
        if self._trials is None and machine.get("configuration"):
            self._trials = Trials(machine["name"], machine["configuration"])
            self.bench.on_frame, self.bench.on_trial = self._at, self._tried

    def _at(self, frame: dict[str, Any]) -> None:
        if self._trials is not None:
            self._trials.frame = frame

    async def _tried(self, values: Mapping[str, Any]) -> str:
        if self._trials is None:
            raise OrderError("nothing runs that could be tried out")
        return await self._trials.tried(values)

    def _changed(self, name: str, value: Any) -> None:
        self._loop.call_soon_threadsafe(self._adopt, name, value)

    def _paused(self, is_paused: bool) -> None:
        self._loop.call_soon_threadsafe(self._tell_pause, is_paused)

    def _adopt(self, name: str, value: Any) -> None:
        """Let trials and pages, those opened later too, have the new value of a live parameter."""
        if name in self._live:  # and not one of how it is run
            settings = [] if self._trials is None else self._trials.changed(name, value)
            self.bench.change(name, value, settings)

    def _tell_pause(self, is_paused: bool) -> None:
        if is_paused != self._is_paused:
            self._is_paused = is_paused
            self.bench.tell("pause", {"is_paused": is_paused})

    async def _obey(self, message: Mapping[str, Any]) -> str:
        if self._hall is not None and message["name"] in HALL_ORDERS:
            return await self._hall.obey(message)
        if self._orders is None:
            raise OrderError("nothing runs that could be commanded")
        text, is_done = await asyncio.wrap_future(self._orders.ask(message))
        if not is_done:
            raise OrderError(text)
        if message["name"] in (PAUSE, GO_ON):
            self._tell_pause(message["name"] == PAUSE)
        return text


def _say(line: Mapping[str, Any]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Serve the machine given on standard input until a signal, or until the parent process ends."""
    settings = json.loads(sys.stdin.readline())
    end_with_parent(settings["parent"])

    async def serve() -> None:  # BenchProcess needs the running loop
        await BenchProcess(settings).serve()

    asyncio.run(serve())
