# SPDX-License-Identifier: Apache-2.0
"""Metrics of a run of a page, and what a monitor asks of it.

Metrics are extremes and means of outputs, impacts of each contact and work of each element.  A monitor asks for
features of one turn of a driven joint, for faults of elements, and for what may vary in the supply.
"""

from collections import deque
from collections.abc import Iterator, Mapping
from math import hypot

import numpy as np

from mech_twin.capabilities.blow_gauge import RecentBlows, blow_remarks
from mech_twin.capabilities.cycle import (
    CycleFeature,
    CycleFeatures,
    CycleReference,
    crank_features,
    event_share,
    event_value,
    gauge_features,
    harmonic,
    swing,
)
from mech_twin.capabilities.faults import (
    EITHER,
    LESS,
    MORE,
    MachineFault,
    OperatingVariable,
    beyond_range,
    motor_variables,
    prescribed_speed,
    rod_faults,
    share_of_key,
    varying_key,
)
from mech_twin.engine.coupling import is_reset
from mech_twin.engine.stored_state import begins_with_state
from mech_twin.errors import StudyError
from mech_twin.machines.crank_run import LAST, Extremes, over_last
from mech_twin.machines.page.equations import PageInstant
from mech_twin.machines.page.force_laws import PageNumbers
from mech_twin.machines.page.parameters import Page, distinct
from mech_twin.machines.page.roles import PageModel
from mech_twin.samples import Event, Frame, LinkageSample


def swinging_joints(page: Page) -> tuple[str, ...]:
    """Return the joints whose position repeats: sliders, and revolutes with a spring or a stop."""
    held = {spring.joint for spring in page.springs.values()} | {contact.joint for contact in page.contacts.values()}
    return tuple(
        n for n, joint in page.joints.items() if joint.kind == "slider" or (joint.kind == "revolute" and n in held)
    )


def joint_features(joint: str, unit: str) -> tuple[CycleFeature, ...]:
    """Return the features of the position of a joint; its mean is none, since a tool may advance."""
    column = f"linkage.{joint}.position"
    return (
        swing(f"{joint}_swing_{unit}", unit, column, f"largest less smallest position of {joint}"),
        harmonic(f"{joint}_cos_1_{unit}", unit, column, 1, "cos", f"position of {joint}, cosine of the turn"),
        harmonic(f"{joint}_sin_1_{unit}", unit, column, 1, "sin", f"position of {joint}, sine of the turn"),
    )


def features(page: Page) -> CycleFeatures:
    """Return the features of a turn of the first turning joint that a drive leads.

    Raises
    ------
    StudyError
        If no drive turns a joint, by which cycles could be counted.
    """
    turning = ((n, d.joint) for n, d in page.drives.items() if d.joint and page.joints[d.joint].kind == "revolute")
    drive, joint = next(turning, ("", ""))
    if not joint:
        raise StudyError("this page has no drive of a turning joint, which cycles could be counted by; expected one")
    impact = (
        event_share("impact_share", "event.impact.time", "when in the turn the first impact comes"),
        event_value(
            "impact_speed_m_per_s", "m/s", "event.impact.pre_velocity", "speed of the hardest impact", "largest"
        ),
        event_value("impulse_ns", "N.s", "event.impact.impulse", "impulse of a turn", "sum"),
    )
    rods = any(contact.rod is not None for contact in page.contacts.values())
    swinging = {n: "m" if page.joints[n].kind == "slider" else "rad" for n in swinging_joints(page) if n != joint}
    return CycleFeatures(
        CycleReference(f"linkage.{joint}.position"),
        (
            *crank_features(f"linkage.{joint}.position", f"motor.{drive}.effort"),
            *(impact if any(contact.rigid for contact in page.contacts.values()) else ()),
            *(gauge_features("impact", "rod") if rods else ()),
            *(feature for n, unit in swinging.items() for feature in joint_features(n, unit)),
        ),
    )


RESISTANCES = tuple(f"against_{way}ward_{unit}" for way in ("for", "back") for unit in ("n", "nm"))


def supply(page: Page) -> tuple[OperatingVariable, ...]:
    """Return the variables of the supply: of induction motors, or its frequency where it prescribes every speed."""
    motors = tuple(f"drives.{name}.motor" for name, drive in page.drives.items() if drive.motor is not None)
    speeds = [
        f"drives.{name}.{key}"
        for name, drive in page.drives.items()
        for key in ("speed_rpm", "speed_m_per_s")
        if getattr(drive, key) is not None
    ]
    prescribed = (prescribed_speed(*speeds),) if speeds and len(speeds) == len(page.drives) else ()
    return motor_variables(*motors) if motors else prescribed


def resistances(page: Page) -> tuple[OperatingVariable, ...]:
    """Return the resistances of joints as operating variables."""
    keys = {n: [f"loads.{n}.{key}" for key in RESISTANCES if getattr(load, key)] for n, load in page.loads.items()}
    return tuple(varying_key(n, f"load {n}", at[0], 0.1, f"{n}_load", *at[1:]) for n, at in keys.items() if at)


def operating(page: Page) -> tuple[OperatingVariable, ...]:
    """Return supply and loads."""
    return (*supply(page), *resistances(page))


# kind of elements, their key, what a fault adds to their name and what it means, its sizes
WEAR = (
    ("springs", "rate_n_per_m", "soft", "the spring is soft or broken", LESS),
    ("springs", "rate_nm_per_rad", "soft", "the spring is soft or broken", LESS),
    ("springs", "preload_n", "preload", "the spring has lost preload", LESS),
    ("springs", "preload_nm", "preload", "the spring has lost preload", LESS),
    ("dampers", "rate_ns_per_m", "weak", "the damper is worn", LESS),
    ("dampers", "rate_nms_per_rad", "weak", "the damper is worn", LESS),
    ("friction", "coulomb_n", "rubs", "the joint rubs more", MORE),
    ("friction", "coulomb_nm", "rubs", "the joint rubs more", MORE),
    ("contacts", "restitution", "restitution", "its faces have changed", EITHER),
    ("contacts", "stiffness_n_per_m", "soft", "its faces are softer", LESS),
    ("contacts", "gives_way_n", "weak", "the wall gives way sooner", LESS),
)


def faults(page: Page) -> tuple[MachineFault, ...]:
    """Return the faults of springs, dampers, friction, contacts and rods, named after them, of supply and loads."""
    found = [
        share_of_key(f"{name}_{what}", meaning, f"{kind}.{name}.{key}", sizes)
        for kind, key, what, meaning, sizes in WEAR
        for name, element in getattr(page, kind).items()
        if getattr(element, key)
    ]
    for name, contact in page.contacts.items():
        if contact.rod is not None:
            key = f"contacts.{name}.rod"
            found += rod_faults(contact.rod, key, f"{key}.wall.threshold_n", f"{name}_")
    return (*found, *map(beyond_range, (*supply(page)[:1], *resistances(page))))


class PageRun:
    """Running numbers of a run, from ``settle_s`` after its start on.

    Parameters
    ----------
    shared : PageModel
        The page.
    """

    def __init__(self, shared: PageModel) -> None:
        self._shared = shared
        self._joints, self._pins, self._quantities = Extremes(), Extremes(), Extremes()
        self._blows: dict[str, list[float]] = {}  # count, largest impulse, sum of impulses, fastest, energy
        self._rods: dict[str, deque[dict[str, float]]] = {n: deque(maxlen=LAST) for n in shared.rods.rods}
        self._recent = {name: RecentBlows() for name in self._rods}
        self._passed: dict[str, float] = {}
        self._struck: dict[str, LinkageSample] = {}  # at the end of the step of the last blow
        self._first = self._last = 0.0
        self._work: dict[str, float] = {}
        self._work_before: dict[str, float] = {}
        self._settled_s = shared.page.settle_s
        self._begun = False

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        linkage, shared = frame.linkage, self._shared
        if not self._is_settled(linkage):
            return
        events = [event for event in linkage.events if event.time_s >= self._settled_s]
        work = {n: v for n, v in linkage.memory.as_dict().items() if n.endswith("_work_j")}
        if not self._begun:
            self._begun, self._first, self._work_before = True, linkage.time_s, work
        self._last = linkage.time_s
        slides = shared.assembly.slides
        for name, position, speed in zip(linkage.joints, linkage.position, linkage.velocity, strict=True):
            unit = "m" if name in slides else "rad"
            self._joints.take(f"{name}_{{}}_{unit}", position)
            self._joints.take(f"{name}_speed_{{}}_{unit}_per_s", speed)
        for pin, wrench in zip(frame.forces.pins, frame.forces.wrenches, strict=True):
            if pin in shared.turning_stops:
                self._pins.take(f"{pin}_moment_max_nm", abs(wrench.moment_nm))
            else:
                self._pins.take(f"{pin}_force_max_n", hypot(wrench.force_x_n, wrench.force_y_n))
        for name, value in frame.forces.quantities.as_dict().items():
            self._quantities.take(_with_place(name), value)
        for event in events:
            if event.kind == "impact":
                self._blow(event.contact, event.impulse_ns, event.pre_velocity_m_per_s, event.post_velocity_m_per_s)
            if shared.rods.has_reading(event):
                if self._recent[event.contact].is_blow(event.time_s, striker_energy(event)):
                    self._rods[event.contact].append(shared.rods.numbers(event))
                    self._struck[event.contact] = linkage
            elif shared.rods.meets(event):
                self._passed[event.contact] = self._passed.get(event.contact, 0.0) + 1.0
        self._work = {name: value - self._work_before[name] for name, value in work.items()}

    def _is_settled(self, linkage: LinkageSample) -> bool:
        """Return whether a sample is of the time that counts; a reset to the initial state has a transient again."""
        page = self._shared.page
        if is_reset(linkage) and not begins_with_state(linkage):
            self._settled_s = linkage.time_s + page.settle_s
        return linkage.time_s >= self._settled_s - 1e-9 * page.coupling.step_s

    def _blow(self, contact: str, impulse: float, before: float, after: float) -> None:
        found = self._blows.setdefault(contact, [0.0, 0.0, 0.0, 0.0, 0.0])
        found[0] += 1.0
        found[1] = max(found[1], impulse)
        found[2] += impulse
        found[3] = max(found[3], before)
        found[4] += 0.5 * impulse * (before + after)  # work of the impulse, at the mean of the speeds

    def numbers(self) -> dict[str, float]:
        """Return the numbers so far; of two with one name, the later bears that of its kind too."""
        out: dict[str, float] = {}
        for kind, found in (("joints", self._joints), ("pins", self._pins), ("forces", self._quantities)):
            for name, ends in found.found.items():
                numbers = Extremes({name: ends}).numbers("")
                while numbers.keys() & out.keys():
                    numbers = {f"{kind}_{key}": value for key, value in numbers.items()}
                out |= numbers
        for kind, numbers in (("contacts", self._of_blows()), ("run", self._of_works())):
            out |= {distinct(kind, name, out): value for name, value in numbers.items()}
        return out

    def _of_blows(self) -> dict[str, float]:
        out: dict[str, float] = {}
        span = self._last - self._first
        for name, (count, largest, total, fastest, energy) in self._blows.items():
            turns = name in self._shared.turning_stops
            speed, impulse, mean = ("rad", "nms", "moment_mean_nm") if turns else ("m", "ns", "force_mean_n")
            out[f"{name}_impacts"] = count
            out[f"{name}_impact_speed_max_{speed}_per_s"] = fastest
            out[f"{name}_impact_impulse_max_{impulse}"] = largest
            out[f"{name}_impact_loss_j"] = energy
            if span > 0.0:
                out[f"{name}_impact_rate_hz"] = count / span
                out[f"{name}_impact_{mean}"] = total / span
        out |= {f"{name}_impulses_without_wave": count for name, count in self._passed.items()}
        for name, blows in self._rods.items():
            if blows:
                out |= over_last(blows, f"steady_{name}_")
                masses = [
                    contact_mass(self._shared, name, self._struck[name], ahead)
                    for ahead in (0.0, blows[-1]["blow_window_s"])
                ]
                out[f"last_{name}_striker_mass_change"] = masses[1] / masses[0] - 1.0
        return out

    def _of_works(self) -> dict[str, float]:
        out = {f"run_{name}": value for name, value in self._work.items()}
        span = self._last - self._first
        if span > 0.0:
            drives = (*self._shared.places.driven_names, *self._shared.places.motors)
            work = sum(self._work.get(f"{name}_work_j", 0.0) for name in drives)
            total = "drive" if drives == ("drive",) else distinct("all", "drive", self._shared.page.named)
            out[f"run_{total}_work_j"] = work
            out["run_power_mean_w"] = work / span
        return out


def striker_energy(event: Event) -> float:
    """Return the energy (J) with which the effective mass at a contact closes on it; of an event with an impulse."""
    closing = event.pre_velocity_m_per_s
    return 0.5 * event.impulse_ns * closing * closing / (closing - event.post_velocity_m_per_s)


def run_remarks(shared: PageModel, numbers: Mapping[str, float]) -> Iterator[str]:
    """Yield remarks on blows as waves, and on a run that ended before its numbers count."""
    yield from blow_remarks(shared.rods.roundings(), numbers)
    settle_s = shared.page.settle_s
    if settle_s > 0.0 and "run_power_mean_w" not in numbers:
        yield f"settle_s = {settle_s:g} s: the run is not longer, so it has no numbers"


def contact_mass(shared: PageModel, contact: str, linkage: LinkageSample, ahead_s: float) -> float:
    """Return the effective mass (kg) at a contact at a time after a sample, extrapolated at constant joint speeds.

    Closed contacts are left out.
    """
    places, assembly = shared.places, shared.assembly
    n, nr, split, state = places.free, places.driven, assembly.split, list(shared.start_state)
    joints = zip(linkage.joints, linkage.position, linkage.velocity, strict=True)
    at = {name: position + ahead_s * speed for name, position, speed in joints}
    for group, begin in ((split.free, 0), (split.dependent, 2 * n), (split.driven, 2 * n + places.dependent)):
        for i, j in enumerate(group):
            state[begin + i] = at[assembly.coordinates[j]]
    now = PageInstant(places, PageNumbers(None), [0.0] * places.controls, 0.0, state)
    values = np.array(now.equations(), dtype=float)
    place = shared.system.law_values + places.laws.index(contact) * (n + nr + 5)
    along = values[place : place + n]
    return float(1.0 / (along @ np.linalg.solve(values[: n * n].reshape(n, n), along)))


def _with_place(name: str) -> str:
    """Return the name of a number with a place for min or max before its unit."""
    for unit in ("_rad_per_s", "_m_per_s", "_rad", "_nm", "_n", "_w", "_m"):
        if name.endswith(unit):
            return f"{name.removesuffix(unit)}_{{}}{unit}"
    return f"{name}_{{}}"
