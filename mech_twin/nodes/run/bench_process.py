# SPDX-License-Identifier: Apache-2.0
"""The bench as a process of its own: the page's server, and a node that passes its orders on to the machine.

It is told on standard input what to serve, and says on standard output where: one line of JSON each way.
"""

from __future__ import annotations

import asyncio
import json
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.nodes.run.bench_hall import DOWNLOAD, LIST, OPEN, OVERLAY, RUN, SALVAGE, Hall
from mech_twin.nodes.run.trials import Trials
from mech_twin.process.parent_death import end_with_parent
from mech_twin.view.bench.link import FEED, PREFIX
from mech_twin.view.bench.server import Bench, OrderError

SERVICE_S = 2.0  # how long a person waits for a service to be found
END_S = 2.0  # that a machine's orders may take to end
HALL_ORDERS = (OPEN, OVERLAY, RUN, SALVAGE, DOWNLOAD, LIST)
SPEED, CHANGE, PAUSE, GO_ON, IDENTIFY = "speed", "change", "pause", "go-on", "identify"


class _Asked(NamedTuple):
    """An order, and where its answer goes."""

    message: Mapping[str, Any]
    answer: Callable[[str, bool], None]


class Orders(threading.Thread):
    """Carries out the orders of a bench, one after the other, by the services of the machine that runs.

    Parameters
    ----------
    namespace : str
        Of the machine.
    changed : callable
        Told of each live parameter that has changed, whoever changed it.
    """

    def __init__(self, namespace: str, changed: Callable[[str, Any], None]) -> None:
        super().__init__(daemon=True, name="orders")
        self._namespace, self._changed = namespace, changed
        self._asked: queue.Queue[_Asked] = queue.Queue()
        self._is_over = False

    def ask(self, asked: _Asked) -> None:
        """Put an order in line."""
        self._asked.put(asked)

    def close(self) -> None:
        """Take no further order, and end."""
        self._is_over = True

    def run(self) -> None:
        """Carry out what is asked for until closed."""
        from mech_twin.nodes.run.telling import Teller

        with Teller(self._namespace, SERVICE_S) as teller:
            teller.watch_parameters(self._changed)
            while not self._is_over:
                teller.serve_until(lambda: self._is_over or not self._asked.empty())
                while not self._asked.empty():
                    asked = self._asked.get()
                    asked.answer(*carried_out(teller, asked.message))


def carried_out(teller: Any, message: Mapping[str, Any]) -> tuple[str, bool]:
    """Return what the machine says of an order, and whether it is done."""
    from mech_twin.nodes.run.domain import UnansweredError
    from mech_twin.nodes.run.telling import ORDERS

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
    """Have the last so many seconds fitted."""
    if "span_s" in values:
        teller.change({"span_s": float(values["span_s"])}, "identifier")
    return str(teller.order(IDENTIFY))


class BenchProcess:
    """Server and orders together."""

    def __init__(self, told: Mapping[str, Any]) -> None:
        self._told = told
        self._orders: Orders | None = None
        self._trials: Trials | None = None
        self._loop = asyncio.get_running_loop()
        self.bench = Bench(self._obey, others=told["others"], history_bytes=told["history_bytes"])
        self.bench.on_machine(self._know)
        self._hall: Hall | None = None
        if told.get("hall"):
            place = f"{PREFIX}{Path(told['folder']) / FEED}"
            shown = Path(told["hall"]["folder"]), told["hall"]["machines"], place
            self._hall = Hall(*shown, self._clear, self.bench.tell, self.bench.offer)

    async def serve(self) -> None:
        """Serve until a signal."""
        over = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            self._loop.add_signal_handler(number, over.set)
        try:
            await self.bench.start(self._told["port"], Path(self._told["folder"]) / FEED)
        except OSError as error:
            why = "is busy" if error.errno == 98 else f"cannot be used ({os.strerror(error.errno or 0)})"
            _say({"error": f"web port {self._told['port']} {why}; choose another one"})
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
        """Pass no further orders on to the machine that ran."""
        trials, orders, self._trials, self._orders = self._trials, self._orders, None, None
        if trials is not None:
            await trials.close()
        if orders is not None:
            orders.close()
            await asyncio.to_thread(orders.join, END_S)

    async def _clear(self) -> None:
        """Forget the machine that ran, when the last of it has come in."""
        await self._let_go()
        await self.bench.begin_anew()

    def _know(self, machine: Mapping[str, Any]) -> None:
        """Begin to pass orders on, if the machine takes any."""
        if self._orders is None and machine.get("namespace"):
            self._orders = Orders(machine["namespace"], self._changed)
            self._orders.start()
        if self._trials is None and machine.get("configuration"):
            self._trials = Trials(machine["name"], machine["configuration"])
            self.bench.on_frame(self._at, self._tried)

    def _at(self, frame: dict[str, Any]) -> None:
        if self._trials is not None:
            self._trials.frame = frame

    async def _tried(self, values: Mapping[str, Any]) -> str:
        if self._trials is None:
            raise OrderError("nothing runs that could be tried out")
        return await self._trials.tried(values)

    def _changed(self, name: str, value: Any) -> None:
        if self._trials is not None:
            self._loop.call_soon_threadsafe(self._trials.changed, name, value)
        self._loop.call_soon_threadsafe(self.bench.tell, "changed", {"name": name, "value": value})

    async def _obey(self, message: Mapping[str, Any]) -> str:
        if self._hall is not None and message["name"] in HALL_ORDERS:
            return await self._hall.obey(message)
        if self._orders is None:
            raise OrderError("nothing runs that could be commanded")
        future: asyncio.Future[tuple[str, bool]] = self._loop.create_future()

        def answer(text: str, is_done: bool) -> None:
            self._loop.call_soon_threadsafe(future.set_result, (text, is_done))

        self._orders.ask(_Asked(message, answer))
        text, is_done = await future
        if not is_done:
            raise OrderError(text)
        if message["name"] in (PAUSE, GO_ON):
            self.bench.tell("pause", {"is_paused": message["name"] == PAUSE})
        return text


def _say(line: Mapping[str, Any]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Serve what standard input tells of until a signal, or until the process that began it ends."""
    told = json.loads(sys.stdin.readline())
    end_with_parent(told["parent"])

    async def serve() -> None:
        await BenchProcess(told).serve()

    asyncio.run(serve())


if __name__ == "__main__":
    main()
