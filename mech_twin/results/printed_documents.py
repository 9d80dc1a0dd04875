# SPDX-License-Identifier: Apache-2.0
"""JSON documents of verbs without a Python function: one class each, with the keys as attributes."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from mech_twin.measurements.measurement_map import Source
from mech_twin.samples import Event
from mech_twin.studies.identification.geometry_fit import FittedAssembly, HeldOut
from mech_twin.studies.identification.sensor_plan import Help
from mech_twin.studies.identification.verdicts import Combination, KeyVerdict
from mech_twin.studies.measured_forces import Compared
from mech_twin.studies.monitoring.findings import FaultEvent, FaultLife
from mech_twin.studies.monitoring.operating import OperatingValue
from mech_twin.studies.monitoring.report import Alarm, Explanation
from mech_twin.studies.monitoring.sensor_design import FaultDesign
from mech_twin.studies.resimulation import Value


class PrintedDocument(BaseModel):
    """A document of a verb, or a part of one: exactly these keys are allowed."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)
    verb: ClassVar[str]

    def __init_subclass__(cls, verb: str = "", **settings: Any) -> None:
        super().__init_subclass__(**settings)
        cls.verb = verb


class RunReport(PrintedDocument, verb="run"):
    """Document of `run`: results of the nodes, the newest events, the number of all by kind, and messages sent."""

    machine: str
    config: Mapping[str, Any]
    summary: Mapping[str, Any]
    events: tuple[Event, ...]
    event_counts: Mapping[str, int] = MappingProxyType({})
    recording: Path | None
    messages_sent: Mapping[str, int]


class RecomputedSample(PrintedDocument):
    """The first sample that differs between a recording and its recomputation."""

    topic: str
    step: int
    time_s: float
    field: str
    recorded: Value
    computed: Value


class RecomputedReport(PrintedDocument, verb="replay"):
    """Document of `replay --analyse` or ``--resimulate``; ``identical`` is None if it is not certain."""

    bag: Path
    recorded_with: tuple[str, ...]
    version: str
    machine: str
    identical: bool | None
    steps_compared: int
    samples_compared: int
    incomplete_steps: int
    parameter_changes: int
    resets: int = 0
    resumed_at_steps: tuple[int, ...]
    unused_samples: Mapping[str, int]
    contradicted_from_step: int | None
    first_difference: RecomputedSample | None


class MeasuredForcesReport(PrintedDocument, verb="replay"):
    """Document of `replay --analyse --map`: largest forces of a measured motion, channels compared with the model."""

    measurement: Path
    machine: str
    samples: int
    crank_zero_rad: float
    largest: Mapping[str, float]
    compared: tuple[Compared, ...]
    left_out: Mapping[str, tuple[str, ...]] = MappingProxyType({})


class RecordingTopic(PrintedDocument):
    """A topic of a recording: type, messages, and loss counters by name."""

    type: str
    messages: int
    counters: Mapping[str, int]


class RecordingFile(PrintedDocument):
    """A file of a recording."""

    file: str
    size_bytes: int | None
    start_s: float | None
    end_s: float | None
    messages: int | None


class RecordingReport(PrintedDocument, verb="info"):
    """Document of `info`: contents of a recording."""

    bag: Path
    machine: str | None
    version: str | None
    finished: bool
    duration_s: float | None
    message_count: int
    topics: Mapping[str, RecordingTopic]
    splits: tuple[RecordingFile, ...]
    configuration: str | None
    problems: tuple[str, ...]


class ExaminedChannel(PrintedDocument):
    """A channel of a measurement by its map, and the quality of its samples, in its own unit."""

    source: Source
    quantity: Annotated[str, Field(alias="is")]
    unit: str | None
    samples: int
    rate_hz: float
    jitter_s: float
    gaps: int
    repeats: int
    back: int
    drift: float
    quantum: float
    saturated: float
    nan: int
    noise: float
    low: float
    high: float
    span_s: float
    flaws: tuple[str, ...]


class ExaminedReport(PrintedDocument, verb="info"):
    """Document of `info --map`: quality of each channel, and contradictions to the map."""

    measurement: Path
    machine: str
    channels: tuple[ExaminedChannel, ...]
    problems: tuple[str, ...]


class ExaminedRun(PrintedDocument):
    """The quality of each channel in one of several runs."""

    measurement: Path
    channels: tuple[ExaminedChannel, ...]


class MapReport(ExaminedReport, verb="map"):
    """Document of `map`: text of the proposed map, and quality of each channel in each run."""

    map: str
    runs: tuple[ExaminedRun, ...]


class CheckedJoint(PrintedDocument):
    """State of a page's joint at the start."""

    joint: str
    kind: str
    role: str
    start: float
    unit: str


class CheckedContact(PrintedDocument):
    """State of a page's contact at the start."""

    contact: str
    state: str
    gap: float
    unit: str


class CheckReport(PrintedDocument, verb="check"):
    """Document of `check`: derived numbers, joints, contacts and masses of a page."""

    page: str
    numbers: Mapping[str, Any]
    joints: tuple[CheckedJoint, ...]
    contacts: tuple[CheckedContact, ...]
    masses_kg: Mapping[str, float]
    remarks: tuple[str, ...]


class FmuReport(PrintedDocument, verb="export fmu"):
    """Document of `export fmu`: the written unit, and its variables for an importer."""

    machine: str
    file: Path
    fmi: int
    platforms: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]


class BouncingRun(PrintedDocument):
    """Restitution from one run."""

    run: Path
    column: str
    restitution: float
    standard_deviation: float
    bounces: int
    flaws: str


class BouncesReport(PrintedDocument, verb="identify"):
    """Document of `identify` from bounces."""

    machine: str
    parameters: tuple[KeyVerdict, ...]
    used: tuple[Path, ...]
    runs: tuple[BouncingRun, ...]
    seconds: float


class FittedChannel(PrintedDocument):
    """Fit of a channel over the fitted runs (percent)."""

    quantity: Annotated[str, Field(alias="is")]
    fit_percent: float


class HeldOutRun(PrintedDocument):
    """The held-out run and its scores."""

    run: Path
    scores: tuple[HeldOut, ...]


class LengthsReport(PrintedDocument, verb="identify"):
    """Document of `identify` for lengths, from the measured motion of the crank."""

    machine: str
    parameters: tuple[KeyVerdict, ...]
    channels: tuple[FittedChannel, ...]
    lags_s: tuple[float, ...]
    assembly: FittedAssembly
    held_out: HeldOutRun | None
    seconds: float


class PlanReport(PrintedDocument, verb="identify"):
    """Document of `identify --plan`: keys that given sensors would identify, and what would help."""

    machine: str
    parameters: tuple[KeyVerdict, ...]
    combinations: tuple[Combination, ...]
    helps: tuple[Help, ...]


class BaselineFeature(PrintedDocument):
    """Statistics of a feature in the healthy cycles."""

    name: str
    unit: str
    mean: float
    sigma: float


class BaselineCycles(PrintedDocument):
    """The healthy cycles: number, order of the autoregression, mean duration."""

    cycles: int
    order: int
    period_s: float


class SetupReport(PrintedDocument):
    """The setup of a monitor."""

    machine: str
    features: tuple[BaselineFeature, ...]
    baseline: BaselineCycles
    arl0_h: float
    arl0_cycles: float
    extrapolated: bool
    thresholds: Mapping[str, float]


class MonitoredRun(PrintedDocument):
    """Result of a monitor for one run."""

    run: Path
    cycles: int
    skipped: int
    alarms: tuple[Alarm, ...]
    faults: tuple[FaultLife, ...]
    events: tuple[FaultEvent, ...]
    operating_point: tuple[OperatingValue, ...]
    without_cycle_s: tuple[float, ...] = ()
    missing: tuple[str, ...] = ()
    explained: tuple[Explanation, ...] = ()


class MonitorReport(SetupReport, verb="monitor"):
    """Document of `monitor`: results of each run."""

    runs: tuple[MonitoredRun, ...]


class SensorSetReport(SetupReport, verb="monitor"):
    """Document of `monitor --design`: detectable faults, and share of row fault that column fault cannot explain."""

    faults: tuple[FaultDesign, ...]
    isolability: Mapping[str, Mapping[str, float]]


class ShadowReport(PrintedDocument, verb="shadow"):
    """Document of `shadow`: last values, numbers of messages sent, and recordings of faults."""

    machine: str
    values: Mapping[str, str]
    messages_sent: Mapping[str, int]
    black_boxes: tuple[Path, ...]
