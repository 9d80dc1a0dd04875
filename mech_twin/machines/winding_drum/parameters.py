"""Parameters of the winding drum."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from mech_twin.engine.coupling import Coupling
from mech_twin.machines.winding_drum.wound_package import WoundPackage
from mech_twin.quantity import Parameters, choice, quantity


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
