# SPDX-License-Identifier: Apache-2.0
"""The identifier node: on request it fits keys of the model to the machine's last minutes, and offers the result.

The fit runs in a process of its own, at lower priority, so that the shadow keeps up.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess

from std_srvs.srv import Trigger

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import MeasurementError, MotionError, StudyError
from mech_twin.measurements.measurement_map import Channel
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.exchange.parameter_bridge import declare_range, offer
from mech_twin.process.interruption import end_with_parent
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.identification import HOLD_OUT_SHARE, Identification, identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion, KeyedConfiguration
from mech_twin.studies.identification.recent_samples import RecentSamples
from mech_twin.studies.identification.written_identification import configuration_text
from mech_twin.studies.observer.estimate import SeenSample
from mech_twin.studies.spreading import NICE

SPAN_S = "span_s"
USUAL_SPAN_S, SHORTEST_SPAN_S, LONGEST_SPAN_S = 60.0, 2.0, 300.0
LATEST_BEGIN_S = 10.0  # latest start of the fitted stretch within the simulated run
FAILURES = (StudyError, MeasurementError, ConfigurationError, MotionError, ValueError)


class _RunningFit:
    """A fit in a process of its own."""

    def __init__(self, question: IdentificationQuestion, run: FitRun) -> None:
        context = get_context("spawn")
        self._end, sender = context.Pipe(duplex=False)
        self._process: SpawnProcess = context.Process(target=_fit, args=(os.getpid(), question, run, sender))
        self._process.start()
        sender.close()

    def messages(self) -> Iterator[str | Exception | Identification]:
        """Yield new messages of the fit: progress lines, finally the result or the reason of its failure."""
        message: str | Exception | Identification = ""
        while isinstance(message, str) and self._end.poll():
            try:
                message = self._end.recv()
            except EOFError:
                self._process.join()
                message = StudyError(f"the fit ended with code {self._process.exitcode}")
            yield message

    def end(self) -> None:
        """End the fit."""
        self._process.terminate()
        self._process.join()


def _fit(parent: int, question: IdentificationQuestion, run: FitRun, connection: Connection) -> None:
    """Fit in a process of lowest priority, which ends with its parent."""
    end_with_parent(parent)
    os.nice(NICE)
    try:
        found = identified(question, [run], (), HOLD_OUT_SHARE, connection.send)
        connection.send(replace(found, fitted=None))
    except FAILURES as error:
        connection.send(StudyError(str(error)))


class IdentifierNode(TwinNode):
    """Identifies keys on request; see `TwinNode` for the other arguments.

    Its service ``identify`` fits the last ``span_s`` seconds, ``take_over`` applies the result to the model.

    Parameters
    ----------
    channels : sequence of Channel
        Of the map.
    keys : sequence of str
        Keys that may change.
    bounds : mapping
        Least and largest value of some of them.

    Raises
    ------
    ConfigurationError
        The machine has no such key, or accepts no other value of it.
    """

    def __init__(
        self,
        machine_name: str,
        channels: Sequence[Channel],
        keys: Sequence[str],
        bounds: dict[str, tuple[float, float]],
        parameters: Parameters | None = None,
    ) -> None:
        super().__init__("identifier", machine_name, parameters)
        self.model = self.initial_parameters
        KeyedConfiguration(machine_name, self.model, tuple(keys)).check()
        self.keys, self._bounds = tuple(keys), dict(bounds)
        self.recent = RecentSamples(channels, LONGEST_SPAN_S)
        self.phase, self.status_line = "idle", "nothing identified yet"
        self.found: Identification | None = None
        self.text, self._stretch = "", ""  # configuration that was found, and of which samples
        self.at_taken: Sequence[Callable[[Parameters], None]] = ()
        self._fit: _RunningFit | None = None
        declare_range(self, SPAN_S, USUAL_SPAN_S, "time before now that is fitted [s]", SHORTEST_SPAN_S, LONGEST_SPAN_S)
        offer(self, Trigger, "~/identify", lambda _: self.identify())
        offer(self, Trigger, "~/take_over", lambda _: self.take_over())

    def observe(self, sample: SeenSample) -> None:
        """Store a sample of the machine."""
        self.recent.add(sample)

    def check_peers(self, now_s: float) -> None:
        """Process the messages of the fit."""
        if self._fit is not None:
            for message in self._fit.messages():
                self._take(message)
        self.diagnostics.state = self.phase

    def diagnostic_values(self) -> dict[str, str]:
        """Return the state of the identification, and estimate, 95 % interval and verdict of each key."""
        keys = () if self.found is None else self.found.keys
        return {"identification": f"{self.phase}: {self.status_line}"} | {
            each.key: f"{each.estimate:.6g} ({each.low_95:.6g} to {each.high_95:.6g}), {each.verdict}" for each in keys
        }

    def close(self) -> None:
        """End a running fit."""
        if self._fit is not None:
            self._fit.end()

    def begin_anew(self, parameters: Parameters) -> None:
        """Forget what was measured and found: a setting of the machine is another."""
        self.close()
        self.model, self.found, self.text, self._fit = parameters, None, "", None
        self.phase, self.status_line = "idle", "a live parameter of the machine has changed"
        self.recent.forget()

    def _take(self, message: str | Exception | Identification) -> None:
        if isinstance(message, str):
            self.status_line = message
            return
        self._fit = None
        if isinstance(message, Exception):
            self.phase, self.status_line = "failed", str(message)
            return
        self.found, self.text = message, configuration_text(message, [self._stretch])
        self.phase = "found" if message.better else "not better"
        self.status_line = "; ".join(filter(None, (f"fitted in {message.seconds:.0f} s", message.lack)))

    def identify(self) -> tuple[bool, str]:
        """Begin a fit of the last seconds, unless one goes on."""
        if self._fit is not None:
            return False, f"a fit goes on: {self.status_line}"
        try:
            run = self.recent.run(float(self.get_parameter(SPAN_S).value))
        except MeasurementError as error:
            return False, str(error)
        question = IdentificationQuestion(
            self.machine_name, self.model, self.keys, self._bounds, longest_begin_s=LATEST_BEGIN_S, cores=1
        )
        self.phase, self.status_line, self.found = "running", f"fitting {run.path}", None
        self._stretch, self.text = str(run.path), ""
        self._fit = _RunningFit(question, run)
        return True, f"{len(self.keys)} keys, {run.path}"

    def take_over(self) -> tuple[bool, str]:
        """Apply the result of the fit to the model."""
        if self.phase != "found" or self.found is None:
            return False, "nothing is found that foretells better than before"
        self.model, self.phase = self.found.parameters, "taken over"
        self.status_line = "the model goes on with what was found"
        for adopt in self.at_taken:
            adopt(self.model)
        return True, self.status_line
