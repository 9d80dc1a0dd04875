# SPDX-License-Identifier: Apache-2.0
"""The bench without a run of its own: it offers the recordings of a folder, and machines and pages to run.

It starts one command at a time, which is shown on the bench: ``view``, ``compare``, ``run``.
"""

import asyncio
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.parameters.load import MACHINE_KEY, PAGE_SUFFIXES, file_tree, is_page
from mech_twin.recording.bag_contents import RecordingReader
from mech_twin.recording.bag_directory import (
    MCAP_SUFFIX,
    SQLITE_SUFFIX,
    bag_files,
    is_named_as_bag,
    is_sqlite_bag,
)
from mech_twin.recording.bag_reader import about_bag, open_bag
from mech_twin.recording.bag_samples import BagSamples, NoSamplesError, recorded_machine
from mech_twin.recording.errors import BagError
from mech_twin.recording.recovery import recover
from mech_twin.studies.resimulation import recorded_settings
from mech_twin.view.bench.bench_page import OrderError
from mech_twin.view.bench.link import BEGUN_BY

OPEN, OVERLAY, RUN, SALVAGE, DOWNLOAD, LIST = "open", "overlay", "run", "salvage", "download", "list"
END_S = 10.0  # time limit for a command to end
SHOWN_LINES = 3  # last lines of stderr that are shown of a failed command


class Hall:
    """The recordings of a folder, and the command being shown.

    Parameters
    ----------
    folder : Path
        Folder of the recordings, new ones too.
    machines : sequence of str
        Machines that may be run, besides the pages of the folder.
    place : str
        Address of the bench, for commands.
    clear : callable
        Clears the bench.
    tell : callable
        Sends a message to the pages.
    offer : callable
        Lets the pages fetch a file once; returns its address.
    """

    def __init__(
        self,
        folder: Path,
        machines: Sequence[str],
        place: str,
        clear: Callable[[], Awaitable[None]],
        tell: Callable[[str, Mapping[str, Any]], None],
        offer: Callable[[Path], str],
    ) -> None:
        self._folder, self._machines, self._place = folder, list(machines), place
        self._clear, self._tell, self._offer = clear, tell, offer
        self._known: dict[tuple[str, int, int], dict[str, Any]] = {}
        self._turn = asyncio.Lock()  # of two orders at once, a double click, the second ends what the first began
        self._process: asyncio.subprocess.Process | None = None
        self._watch: asyncio.Task[None] | None = None

    async def look(self) -> None:
        """Send the pages the recordings, newest first, and the machines that may be run."""
        recordings = await asyncio.to_thread(self._recordings)
        self._tell("hall", {"folder": self._folder.name, "recordings": recordings, "machines": self._runnable()})

    async def obey(self, message: Mapping[str, Any]) -> str:
        """Execute an order; return a line on its result.

        Raises
        ------
        OrderError
            If it names nothing that exists, or it failed.
        """
        name, values = message["name"], message.get("values", {})
        if name == LIST:
            await self.look()
            return "list of recordings"
        if name == RUN:
            machine = self._named(values, "machine", self._runnable())
            kept = f"{Path(machine).stem}-{datetime.now():%Y%m%d-%H%M%S}"
            return await self._begin("run", *self._words_for(machine), "--record", kept)
        first = self._recording(values, "recording")
        if name == OPEN:
            return await self._begin("view", first.name)
        if name == OVERLAY:
            return await self._begin("compare", first.name, self._recording(values, "other").name, "--view", "web")
        if name == DOWNLOAD:
            try:
                held = bag_files(first, SQLITE_SUFFIX if is_sqlite_bag(first) else MCAP_SUFFIX)
            except BagError as error:  # deleted since it was listed, or a link out of the folder
                raise OrderError(f"download {first.name}: {error}") from error
            files = [{"name": file.name, "address": self._offer(file)} for file in held]
            self._tell("offer", {"id": message.get("id"), "files": files})
            return f"{first.name}: {len(files)} file{'' if len(files) == 1 else 's'}"
        return await self._salvaged(first)

    async def close(self) -> None:
        """End the command being shown."""
        process, self._process = self._process, None
        if self._watch is not None:
            self._watch.cancel()
        if process is None or process.returncode is not None:
            return
        process.terminate()
        try:
            async with asyncio.timeout(END_S):
                await process.communicate()
        except TimeoutError:
            process.kill()
            await process.wait()

    async def _begin(self, *words: str) -> str:
        async with self._turn:
            await self.close()
            await self._clear()
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "mech_twin", *words),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                cwd=self._folder,
                env=os.environ | {BEGUN_BY: self._place},
            )
            self._tell("status", {"text": f"{' '.join(words[:2])} begins"})
            self._watch = asyncio.create_task(self._watched(self._process, words[0]))
        return " ".join(words)

    async def _watched(self, process: asyncio.subprocess.Process, verb: str) -> None:
        """Notify the pages when a command is over, with its output if it failed."""
        assert process.stderr is not None
        last_lines: list[str] = []
        async for line in process.stderr:
            last_lines = [*last_lines, line.decode(errors="replace").strip()][-SHOWN_LINES:]
        code = await process.wait()
        failed = code not in (0, 1) if verb == "compare" else code != 0
        reasons = [line for line in last_lines if line.startswith("mech-twin: ")] or last_lines
        if code < 0:
            reasons = [f"ended by signal {-code} ({signal.strsignal(-code)})", *reasons]
        text = f"{verb}: {'; '.join(reasons)}" if failed else f"{verb} is over"
        if failed:
            self._tell("status", {"text": text})
        self._tell("end", {"text": text, "has_failed": failed})
        await self.look()

    async def _salvaged(self, bag: Path) -> str:
        out = self._folder / f"{bag.stem}_salvaged"
        try:
            report = await asyncio.to_thread(recover, bag, out)
        except (BagError, OSError, ValueError) as error:
            raise OrderError(f"salvage {bag.name}: {error}") from error
        await self.look()
        return f"{out.name}: {sum(report.messages.values())} messages salvaged"

    def _recording(self, values: Mapping[str, Any], key: str) -> Path:
        return self._folder / self._named(values, key, [path.name for path in self._paths()])

    @staticmethod
    def _named(values: Mapping[str, Any], key: str, known: Sequence[str]) -> str:
        """Return the named entry of the list; other paths are refused, so none leads out of the folder."""
        if values.get(key) not in known:
            raise OrderError(f"{key} {values.get(key)!r}: expected one of the list ({len(known)})")
        return str(values[key])

    def _words_for(self, name: str) -> list[str]:
        """Return the words that run an entry of the list: of a configuration its machine, with the file."""
        with suppress(ConfigurationError):  # the run says why
            meant = file_tree(self._folder / name).get(MACHINE_KEY) if is_page(name) else None
            if meant in self._machines:
                return [str(meant), "--config", name]
        return [name]

    def _runnable(self) -> list[str]:
        """Return the machines, and the pages and configurations that now are in the folder."""
        own = sorted(path.name for suffix in PAGE_SUFFIXES for path in self._folder.glob(f"*{suffix}"))
        return [*self._machines, *own]

    def _paths(self) -> list[Path]:
        return sorted(
            filter(is_named_as_bag, self._folder.iterdir()), key=lambda path: path.stat().st_mtime, reverse=True
        )

    def _recordings(self) -> list[dict[str, Any]]:
        rows = []
        for path in self._paths():
            size = sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))
            key = (path.name, path.stat().st_mtime_ns, size)
            if key not in self._known:
                self._known[key] = _described(path)
            rows.append({"name": path.name, "size_bytes": size, **self._known[key]})
        return rows


def _machine_and_settings(reader: RecordingReader) -> tuple[str, list[list[str]]]:
    """Return the machine of a recording, and its settings that differ from the installed ones."""
    name, settings = recorded_settings(BagSamples(reader).descriptions())
    return name or recorded_machine(reader), settings


def _described(path: Path) -> dict[str, Any]:
    """Return machine, length (s), settings and state of a recording, and whether it opens, or may be salvaged."""
    kept = not is_sqlite_bag(path)  # `recover` takes no other
    unknown: dict[str, Any] = {"machine": "", "length_s": None, "opens": False, "salvages": kept, "settings": []}
    try:
        info, (machine, settings) = about_bag(path, _machine_and_settings)
    except NoSamplesError as error:
        return unknown | {"salvages": False, "state": f"it {error.reason.partition(';')[0]}"}
    except BagError as error:
        return unknown | {"state": f"damaged: {error}"}
    known = unknown | {"machine": machine, "length_s": round(info.duration_s, 3), "settings": settings}
    try:
        with open_bag(path):
            state = "complete" if not info.problems else "closed, but not complete"
            return known | {"opens": True, "state": state}
    except BagError:
        return known | {"state": "damaged" if info.finished else "not closed"}
