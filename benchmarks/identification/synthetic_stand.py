# SPDX-License-Identifier: Apache-2.0
"""A test stand that does not exist: a machine with other numbers, seen through sensors, read back by a map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from mech_twin.engine.run import frames
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import read_run
from mech_twin.measurements.sensors import SensorBench, sensor_table
from mech_twin.measurements.tables import TableReader
from mech_twin.measurements.units import machine_columns
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.samples import Frame
from mech_twin.studies.identification.fit_runs import FitRun, fit_run
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration


@dataclass(frozen=True)
class Stand:
    """A machine on the stand.

    Attributes
    ----------
    name : str
        Machine of the catalogue.
    duration_s : float
        Length of its run.
    true : dict
        What the machine on the stand is, by configuration key.
    sensors : list of dict
        Channels as of ``simulate --sensors``.
    opened : dict
        What of the sensors the map leaves open: ``{"linkage.crank.position": {"zero": "free"}}``.
    keys : tuple of str
        Keys that a fit may change.
    never : tuple of str
        Keys of which nobody may say that they were identified.
    """

    name: str
    duration_s: float
    true: dict[str, float]
    sensors: list[dict[str, Any]]
    opened: dict[str, dict[str, Any]]
    keys: tuple[str, ...]
    never: tuple[str, ...] = ()

    def run(self, folder: Path, seed: int) -> FitRun:
        """Return one run of the machine as its sensors show it."""
        given = self._map(self.sensors)
        built = machine(self.name, None, self.true)
        bench = SensorBench(given, machine_columns(built), built.coupling_step_s, seed)
        path = folder / f"{self.name}_{seed}.csv"
        with sensor_table(path, given) as writer:
            for frame in self._frames:
                for reading in bench.observe(frame):
                    writer.read(reading)
            for reading in bench.rest():
                writer.read(reading)
        return fit_run(read_run(TableReader(path), self.maps()[1]), begin_known=True)

    @cached_property
    def _frames(self) -> list[Frame]:
        """The machine's run, which its sensors see another way each time."""
        return list(frames(machine(self.name, None, self.true), self.duration_s))

    def maps(self) -> tuple[MeasurementMap, MeasurementMap]:
        """Return the sensors, and the map of their runs, which leaves some of them open."""
        opened = [{**each, **self.opened.get(each["is"], {})} for each in self.sensors]
        return self._map(self.sensors), self._map(opened)

    def truth(self) -> dict[str, float]:
        """Return the keys that a fit may change as the machine on the stand has them."""
        keyed = KeyedConfiguration(self.name, machine_parameters(self.name), self.keys)
        return {**dict(zip(self.keys, keyed.values().tolist(), strict=True)), **self.true}

    def shortened(self, duration_s: float, keys: tuple[str, ...]) -> Stand:
        """Return a shorter run with fewer open keys; the others are known, so that each can be told."""
        true = {key: value for key, value in self.true.items() if key in keys}
        return replace(self, duration_s=duration_s, true=true, keys=keys, never=())

    def _map(self, channels: list[dict[str, Any]]) -> MeasurementMap:
        tree = {"machine": self.name, "time": {"column": "time_s"}, "channels": channels}
        return MeasurementMap.model_validate(tree)


def sensor(column: str, rate_hz: float, sigma: float, **keys: Any) -> dict[str, Any]:
    """Return a channel that samples a column."""
    return {"source": {"column": column}, "is": column, "rate_hz": rate_hz, "sigma": sigma, **keys}


def event(column: str, sigma: float) -> dict[str, Any]:
    """Return a channel of events."""
    return {"source": {"column": column}, "is": column, "sigma": sigma}


STANDS = {
    stand.name: stand
    for stand in (
        Stand(
            "vibration_crank",
            2.4,
            {"crank_m": 0.131, "rod_m": 0.47, "masses.tree_kg": 58.0, "working_force_n": 120.0},
            [
                sensor("linkage.crank.position", 200.0, 0.002, zero=0.3, quantum=1e-3, drop=0.02),
                sensor("linkage.slider.position", 150.0, 3e-4, zero=0.04, lag_s=0.004, jitter_s=3e-4),
                sensor("motor.motor.effort", 200.0, 2.0),
            ],
            {
                "linkage.crank.position": {"zero": "per_run"},
                "linkage.slider.position": {"zero": "free", "lag_s": "free"},
            },
            (
                "crank_m", "rod_m", "masses.tree_kg", "working_force_n", "counterweight.radius_m",
                "counterweight.mass_kg",
            ),
            ("counterweight.radius_m", "counterweight.mass_kg"),
        ),
        Stand(
            "compaction_press",
            2.0,
            {
                "linkage.crank_m": 0.062, "linkage.pendulum_m": 0.31, "linkage.coupler_m": 0.52,
                "links.plate.mass_kg": 44.0, "links.plate.inertia_kg_m2": 0.9,
                "working_force.peak_n": 11000.0, "working_force.contact_fraction": 0.45,
            },
            [
                sensor("linkage.crank.position", 400.0, 0.001),
                sensor("linkage.plate.position", 400.0, 3e-4),
                sensor("linkage.pendulum.position", 250.0, 3e-4, zero=0.1),
                sensor("motor.motor.effort", 500.0, 1.0),
            ],
            {"linkage.pendulum.position": {"zero": "free"}},
            (
                "linkage.crank_m", "linkage.pendulum_m", "linkage.coupler_m", "links.plate.mass_kg",
                "links.plate.inertia_kg_m2", "links.crank.inertia_kg_m2", "flywheel.inertia_kg_m2",
                "working_force.peak_n", "working_force.contact_fraction",
            ),
            ("links.crank.inertia_kg_m2", "flywheel.inertia_kg_m2"),
        ),
        Stand(
            "impact_mass",
            0.8,
            {"restitution": 0.36, "phase1_force_n": 1080.0, "phase2_force_n": -470.0, "mass_kg": 1.1},
            [
                sensor("linkage.mass.position", 2000.0, 2e-4),
                event("event.impact.time", 1e-5),
                event("event.impact.pre_velocity", 0.01),
                event("event.impact.post_velocity", 0.01),
            ],
            {},
            ("restitution", "phase1_force_n", "phase2_force_n", "mass_kg", "phase1_duration_s"),
            ("phase1_force_n", "phase2_force_n", "mass_kg"),
        ),
        Stand(
            "roller_former",
            4.0,
            {"drive.efficiency": 0.85, "drive.stiffness_nm_per_rad": 100000.0, "drive.damping_nms_per_rad": 7600.0},
            [
                sensor("linkage.crank.position", 300.0, 1e-3),
                sensor("linkage.drive.velocity", 300.0, 0.02),
                sensor("forces.coupling_moment_nm", 300.0, 10.0),
            ],
            {},
            (
                "drive.efficiency", "drive.stiffness_nm_per_rad", "drive.damping_nms_per_rad",
                "drive.coupling_inertia_kg_m2",
                "carts.friction", "carts.guide_roller_m", "load_sets.table.weight_n",
            ),
            ("carts.friction", "carts.guide_roller_m", "load_sets.table.weight_n"),
        ),
        Stand(
            "winding_drum",
            16.0,
            {
                "eccentricity_m": 0.0045, "package_density_kg_per_m3": 480.0, "drum_inertia_kg_m2": 0.55,
                "yarn_speed_m_per_s": 4.6, "layer_thickness_m": 6.2e-4, "yarn_acceleration_m_per_s2": 0.42,
            },
            [
                sensor("linkage.drum.position", 100.0, 0.005),
                sensor("forces.dynamic_torque_nm", 100.0, 0.1),
                sensor("linkage.yarn.velocity", 100.0, 0.01),
            ],
            {},
            (
                "eccentricity_m", "package_density_kg_per_m3", "package_width_m", "drum_inertia_kg_m2",
                "yarn_speed_m_per_s", "layer_thickness_m", "yarn_acceleration_m_per_s2", "core_radius_m",
            ),
            ("package_density_kg_per_m3", "package_width_m", "core_radius_m", "drum_inertia_kg_m2"),
        ),
        Stand(
            "mb10_breaker",
            3.0,
            {
                "body.spring_rate_n_per_m": 56000.0, "body.preload_deflection_m": 0.0135, "body.inertia_kg_m2": 6.4,
                "body.restitution": 0.36, "tool.overtravel_m": 0.0034, "linkage.crank_inertia_kg_m2": 0.33,
                "tool.mass_kg": 11.0, "tool.restitution": 0.40,
            },
            [
                sensor("linkage.crank.position", 400.0, 0.002),
                sensor("linkage.body.position", 400.0, 2e-5),
                sensor("linkage.body.velocity", 400.0, 2e-3),
                sensor("motor.rotor.effort", 400.0, 0.05),
                event("event.blow.time", 1e-5),
            ],
            {},
            (
                "body.spring_rate_n_per_m", "body.preload_deflection_m", "body.inertia_kg_m2", "body.restitution",
                "tool.overtravel_m", "linkage.crank_inertia_kg_m2", "tool.mass_kg", "tool.restitution",
            ),
            ("tool.mass_kg", "tool.restitution"),
        ),
    )
}  # fmt: skip

# Small enough to be repeated hundreds of times: a short run, and keys that it tells clearly, so that which repeats
# call a key identified does not depend on its estimate.
SHORT_STANDS = {
    name: STANDS[name].shortened(duration_s, keys)
    for name, duration_s, keys in (
        ("vibration_crank", 1.2, ("crank_m", "rod_m", "masses.tree_kg")),
        ("compaction_press", 0.6, ("linkage.crank_m", "linkage.pendulum_m", "links.plate.mass_kg")),
        ("impact_mass", 0.4, ("restitution", "phase1_duration_s")),
        ("roller_former", 1.5, ("drive.efficiency", "drive.stiffness_nm_per_rad")),
        ("winding_drum", 4.0, ("eccentricity_m", "drum_inertia_kg_m2", "yarn_speed_m_per_s")),
        ("mb10_breaker", 0.6, ("body.spring_rate_n_per_m", "body.restitution", "tool.overtravel_m")),
    )
}
