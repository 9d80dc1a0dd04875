# SPDX-License-Identifier: Apache-2.0
"""Parameters of the winding drum, and the constants of its motion."""

from __future__ import annotations

from math import pi
from typing import Literal

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, quantity, upper
from mech_twin.engine.coupling import Coupling
from mech_twin.machines.winding_drum.dynamics import Package, package_inertia, wound_at
from mech_twin.parts.friction_and_gear import Friction

MOST_OFFSET = 0.9  # of the core radius: nearer to it the arm of the yarn vanishes once a turn
LEAST_WOUND = 1.001  # package over core: of a thinner layer, the yarn is a small difference of two areas
MOST_TURN_RAD = 2000.0  # of the drum in one coupling step
MOST_DECAYS = 1e4  # time constants of the full package, slowed by its bearings, in one coupling step


class WoundPackage(Parameters):
    """A yarn package, its drum and the yarn that runs off or onto it."""

    package_radius_m: float = quantity("m", "radius of the full package", gt=0.0)
    core_radius_m: float = quantity("m", "radius of the bare drum, where the package is empty", gt=0.0)
    package_width_m: float = quantity("m", "width of the package along the axis", gt=0.0)
    eccentricity_m: float = quantity(
        "m", "offset of the package's centre from the axis; 0 is the ideal package", ge=0.0
    )
    layer_thickness_m: float = quantity("m", "thickness of one layer of yarn", gt=0.0)
    yarn_speed_m_per_s: float = quantity("m/s", "rated yarn speed", gt=0.0, live=True)
    yarn_acceleration_m_per_s2: float = quantity("m/s2", "acceleration of the yarn while its speed changes", ge=0.0)
    package_density_kg_per_m3: float = quantity("kg/m3", "density of the package, its specific weight over g", gt=0.0)
    drum_inertia_kg_m2: float = quantity("kg m2", "moment of inertia of the bare drum", gt=0.0)
    gravity_m_per_s2: float = quantity("m/s2", "gravity across the horizontal axis", default=9.80665, ge=0.0)
    friction: Friction = choice("friction of the drum's bearings", default=Friction())

    @model_validator(mode="after")
    def _sizes_fit(self) -> WoundPackage:
        if self.package_radius_m < LEAST_WOUND * self.core_radius_m:
            raise ValueError(
                f"package_radius_m >= {LEAST_WOUND:g} core_radius_m fails: "
                f"{self.package_radius_m!r} m >= {LEAST_WOUND * self.core_radius_m!r} m"
            )
        if self.eccentricity_m > MOST_OFFSET * self.core_radius_m:
            raise ValueError(
                f"eccentricity_m <= {MOST_OFFSET:g} core_radius_m fails: "
                f"{self.eccentricity_m} m <= {upper(MOST_OFFSET * self.core_radius_m)} m"
            )
        if self.layer_thickness_m > self.package_radius_m - self.core_radius_m:
            raise ValueError(
                "layer_thickness_m <= package_radius_m - core_radius_m fails: "
                f"{self.layer_thickness_m} m <= {upper(self.package_radius_m - self.core_radius_m)} m"
            )
        return self


class YarnSupply(Parameters):
    """Supply of the drive; its rate is derived from the yarn's acceleration where it is not given."""

    initial_fraction: float = quantity("1", "fraction of rated yarn speed at the start", ge=0.0, le=1.0)
    rate_per_s: float | None = quantity(
        "1/s", "largest change of the supply fraction in a second", default=None, gt=0.0
    )


class WindingDrum(WoundPackage):
    """Parameters of the winding drum."""

    direction: Literal["unwinding", "winding"] = choice("whether yarn leaves or joins the package", default="unwinding")
    supply: YarnSupply = choice("supply of the drive")
    coupling: Coupling = choice("coupling of the roles")

    @model_validator(mode="after")
    def _speed_can_change(self) -> WindingDrum:
        if self.supply.rate_per_s is None and self.yarn_acceleration_m_per_s2 == 0.0:
            raise ValueError("yarn_acceleration_m_per_s2 > 0 fails: it gives supply.rate_per_s where that is absent")
        turn = self.yarn_speed_m_per_s * self.coupling.step_s / (self.core_radius_m - self.eccentricity_m)
        if turn > MOST_TURN_RAD:
            raise ValueError(
                f"yarn_speed_m_per_s coupling.step_s / (core_radius_m - eccentricity_m) <= {MOST_TURN_RAD:g} fails: "
                f"the drum would turn by {turn:.3g} rad in one step; shorten coupling.step_s"
            )
        full = package_constants(self, True)
        inertia = package_inertia(full, wound_at(full, self.package_radius_m))
        slowed = self.friction.viscous_nms_per_rad * self.coupling.step_s / inertia
        if self.direction == "winding" and slowed > MOST_DECAYS:
            raise ValueError(
                f"friction.viscous_nms_per_rad coupling.step_s / inertia of the full package <= {MOST_DECAYS:g} fails: "
                f"{slowed:.3g}; shorten coupling.step_s"
            )
        return self

    @property
    def rate_per_s(self) -> float:
        """Rate of the supply fraction (1/s)."""
        return self.supply.rate_per_s or self.yarn_acceleration_m_per_s2 / self.yarn_speed_m_per_s

    @property
    def radii_m(self) -> tuple[float, float]:
        """Package radius at the start and at the end of the run (m)."""
        if self.direction == "winding":
            return self.core_radius_m, self.package_radius_m
        return self.package_radius_m, self.core_radius_m


def package_constants(parameters: WoundPackage, winding: bool) -> Package:
    """Return the constants of the kernels; winding turns the sign of L."""
    layer = parameters.layer_thickness_m / (2.0 * pi)
    return Package(
        core_m=parameters.core_radius_m,
        width_m=parameters.package_width_m,
        eccentricity_m=parameters.eccentricity_m,
        layer_m=-layer if winding else layer,
        density=parameters.package_density_kg_per_m3,
        drum_inertia=parameters.drum_inertia_kg_m2,
        gravity=parameters.gravity_m_per_s2,
        coulomb_nm=parameters.friction.coulomb_nm,
        viscous_nms_per_rad=parameters.friction.viscous_nms_per_rad,
    )
