# SPDX-License-Identifier: Apache-2.0
"""What a run would do next with other values, rolled out beside it by a process of its own.

That process has one line of JSON in and one out, the latter as the page reads it::

    bench --- {"name", "tree", "frame"} ---> roll-out
          <-- {"kind": "ghost", ...} -------
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import Mapping
from typing import Any

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree, tree_from_flat
from mech_twin.process.parent_death import end_with_parent
from mech_twin.view.bench.link import LARGEST_BYTES
from mech_twin.view.bench.server import OrderError

SPAN_S = 0.3  # of the machine's time: three blows of the breaker
PROGRAM = "from mech_twin.nodes.run.trials import main; main()"


class Trials:
    """Roll-outs of one machine, one at a time.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    configuration : mapping
        Its whole configuration.
    """

    def __init__(self, name: str, configuration: Mapping[str, Any]) -> None:
        self._name, self._configuration = name, dict(configuration)
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()
        self.frame: dict[str, Any] | None = None

    def changed(self, key: str, value: Any) -> None:
        """Take over a live parameter that has changed."""
        self._configuration = merged_tree(self._configuration, tree_from_flat({key: value}))

    async def tried(self, values: Mapping[str, Any]) -> str:
        """Return, for the page, curves and cards of the next moments with these values, or why there are none.

        Raises
        ------
        OrderError
            Nothing runs yet, or the roll-out has ended.
        """
        if self.frame is None:
            raise OrderError("nothing runs yet")
        try:
            tree = merged_tree(self._configuration, tree_from_flat(dict(values)))
        except ConfigurationError as error:
            raise OrderError(str(error)) from error
        asked = {"parent": os.getpid(), "name": self._name, "tree": tree, "frame": self.frame}
        async with self._turn:
            if self._process is None:
                self._process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    "-c",
                    PROGRAM,
                    stdin=asyncio.subprocess.PIPE,
                    stdout=asyncio.subprocess.PIPE,
                    limit=LARGEST_BYTES,
                )
            told, said = self._process.stdin, self._process.stdout
            assert told is not None
            assert said is not None
            told.write(json.dumps(asked).encode() + b"\n")
            answer = await said.readline()
            if not answer:
                self._process = None
                raise OrderError("the trial was ended")
        return answer.decode()

    async def close(self) -> None:
        """Let the process go."""
        if self._process is not None:
            if self._process.returncode is None:
                self._process.kill()
            await self._process.wait()


def rolled_out(name: str, tree: dict[str, Any], content: dict[str, Any]) -> dict[str, Any]:
    """Return what the page draws of the next moments of a machine from a frame on."""
    from mech_twin.engine.run import continued
    from mech_twin.engine.trajectory import frame_events
    from mech_twin.parameters.load import catalogue_entry, validated
    from mech_twin.view.banner import Banner
    from mech_twin.view.bench.frame_text import framed
    from mech_twin.view.bench.picture import packed_curves
    from mech_twin.view.bench.scene import RoleCurves, body_regimes
    from mech_twin.view.sending import LIVE

    entry = catalogue_entry(name)
    machine = entry.build(validated(entry, tree, "trial"))
    begin = framed(content)
    roles = RoleCurves(frozenset() if machine.mechanism is None else machine.mechanism.sliding_joints)
    banner = Banner(machine.mechanism, *([] if machine.blow_energy is None else [machine.blow_energy]))
    banner.body_regimes = body_regimes(machine)
    for frame in continued(machine, begin, SPAN_S, begin.motor.command):
        roles.add(frame.motor, frame.linkage, frame.forces, frame.body)
        banner.add(frame.motor, frame.linkage, frame.forces, frame.body)
        for event in frame_events(frame):
            banner.strike(event)
    return {
        "from_s": begin.linkage.time_s,
        "to_s": begin.linkage.time_s + SPAN_S,
        "curves": packed_curves(roles.taken(LIVE)),
        "cards": banner.cards(),
    }


def main() -> None:
    """Roll out what each line of standard input asks for."""
    from mech_twin.engine.errors import MotionError

    out, sys.stdout = sys.stdout, sys.stderr  # nothing else goes into the answers
    for line in sys.stdin:
        asked = json.loads(line)
        end_with_parent(asked["parent"])
        try:
            answer = rolled_out(asked["name"], asked["tree"], asked["frame"])
        except (ConfigurationError, MotionError) as error:
            answer = {"refused": str(error)}
        out.write(json.dumps({"kind": "ghost", **answer}, separators=(",", ":")) + "\n")
        out.flush()


if __name__ == "__main__":
    main()
