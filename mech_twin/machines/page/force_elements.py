# SPDX-License-Identifier: Apache-2.0
"""Elements of a page that act by length, speed or gas: springs, gas springs, dampers, friction, couplings."""

from typing import Literal, Self

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, quantity
from mech_twin.machines.page.elements import DEGREE, Name, one_of, only
from mech_twin.machines.page.tables import TableRows, table

AIR_PA = 101325.0


class GasPort(Parameters):
    """A port of a gas spring: beyond a travel of a slider the gas is at ambient pressure."""

    joint: str = choice("slider whose travel opens the port")
    open_above_m: float | None = quantity("m", "travel above which the port is open", default=None)
    open_below_m: float | None = quantity("m", "travel below which the port is open", default=None)

    @model_validator(mode="after")
    def _one_limit(self) -> Self:
        one_of(self, "open_above_m", "open_below_m")
        return self


class GasCharge(Parameters):
    """The gas of a gas spring: p (V/m)^n stays as it is but for leak and ports."""

    area_m2: float = quantity("m2", "area of the piston; of a joint less than 0 where growing travel compresses")
    volume_m3: float = quantity("m3", "volume at the start", gt=0.0)
    pressure_pa: float = quantity("Pa", "absolute pressure at the start", default=AIR_PA, gt=0.0)
    ambient_pa: float = quantity("Pa", "pressure outside", default=AIR_PA, ge=0.0)
    exponent: float = quantity("1", "exponent n: 1 isothermal, 1.4 air without heat", default=1.4, ge=1.0, le=2.0)
    leak_per_s: float = quantity(
        "1/s", "share of the gas lost a second, at an excess of one start pressure", default=0.0, ge=0.0
    )
    ports: dict[Name, GasPort] = choice("ports by name", default={})

    @model_validator(mode="after")
    def _has_area(self) -> Self:
        if self.area_m2 == 0.0:
            raise ValueError("area_m2 must not be 0")
        return self


class CouplingElement(Parameters):
    """An elastic shaft, gear, belt or rack between two joints: rate and damping of what they miss of their ratio.

    Gear, belt and rack are firm without a rate.
    """

    kind: Literal["shaft", "gear", "belt", "rack"] = choice(
        "shaft, or gear or belt with a ratio, between revolutes; rack: a pinion's revolute, then a slider"
    )
    joints: tuple[str, str] = choice(
        "the two joints that it couples; they mesh as they start: without force, amid the play"
    )
    ratio: float | None = quantity(
        "1", "of gear or belt: turns of the second joint for one of the first; below 0: the other way", default=None
    )
    radius_m: float | None = quantity(
        "m", "of a rack: travel of the slider for a radian of the pinion; below 0: backward", default=None
    )
    rate_nm_per_rad: float | None = quantity("N m/rad", "rate at the second joint", live=True, default=None, gt=0.0)
    rate_n_per_m: float | None = quantity("N/m", "rate of a rack", live=True, default=None, gt=0.0)
    damping_nms_per_rad: float = quantity("N m s/rad", "damping while it carries", live=True, default=0.0, ge=0.0)
    damping_ns_per_m: float = quantity("N s/m", "damping of a rack while it carries", live=True, default=0.0, ge=0.0)
    backlash_deg: float = quantity("deg", "play in all, at the second joint", default=0.0, ge=0.0, le=90.0)
    backlash_m: float = quantity("m", "play of a rack in all", default=0.0, ge=0.0)
    efficiency: float = quantity(
        "1", "share that a gear, belt or rack passes on, either way", default=1.0, gt=0.0, le=1.0
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "rack":
            elastic = ("rate_n_per_m", "damping_ns_per_m", "backlash_m", "efficiency")
            only(self, "rack", ("joints", "radius_m"), elastic)
        elif self.kind == "shaft":
            only(self, "shaft", ("joints", "rate_nm_per_rad"), ("damping_nms_per_rad", "backlash_deg"))
        else:
            play = ("backlash_deg",) if self.kind == "gear" else ()
            elastic = ("rate_nm_per_rad", "damping_nms_per_rad", "efficiency", *play)
            only(self, self.kind, ("joints", "ratio"), elastic)
        if self.firm and (self.damping > 0.0 or self.backlash > 0.0 or self.efficiency < 1.0):
            rate = "rate_n_per_m" if self.slides else "rate_nm_per_rad"
            raise ValueError(f"damping, play and efficiency need the key {rate}; without it a {self.kind} is firm")
        if self.factor == 0.0:
            raise ValueError(f"{'radius_m' if self.kind == 'rack' else 'ratio'} must not be 0")
        if self.kind == "belt" and self.factor < 0.0:
            raise ValueError("ratio of a belt must be above 0; a crossed one is a gear with a ratio below 0")
        return self

    def unused(self) -> frozenset[str]:
        """Return damping and play in the other unit, of a firm one in either."""
        turning, sliding = {"damping_nms_per_rad", "backlash_deg"}, {"damping_ns_per_m", "backlash_m"}
        return frozenset(turning | sliding if self.firm else turning if self.slides else sliding)

    @property
    def slides(self) -> bool:
        """Whether its second joint is a slider."""
        return self.kind == "rack"

    @property
    def firm(self) -> bool:
        """Whether it is a firm ratio."""
        return self.rate == 0.0

    @property
    def factor(self) -> float:
        """Motion of the second joint for that of the first."""
        found = self.radius_m if self.slides else self.ratio
        return 1.0 if found is None else found

    @property
    def rate(self) -> float:
        """Rate at the second joint (N m/rad or N/m)."""
        return (self.rate_n_per_m if self.slides else self.rate_nm_per_rad) or 0.0

    @property
    def damping(self) -> float:
        """Damping at the second joint (N m s/rad or N s/m)."""
        return self.damping_ns_per_m if self.slides else self.damping_nms_per_rad

    @property
    def backlash(self) -> float:
        """Play in all at the second joint (rad or m)."""
        return self.backlash_m if self.slides else self.backlash_deg * DEGREE


class SpringElement(Parameters):
    """A spring between two points, or of a joint: linear, progressive by table, or of gas."""

    between: tuple[str, str] | None = choice("the two points", default=None)
    joint: str | None = choice("joint along which it acts", default=None)
    rate_n_per_m: float | None = quantity("N/m", "rate of a spring along a length", live=True, default=None, ge=0.0)
    rate_nm_per_rad: float | None = quantity("N m/rad", "rate of a turning spring", live=True, default=None, ge=0.0)
    free_m: float | None = quantity("m", "length, or travel, without force", default=None)
    free_deg: float | None = quantity("deg", "angle without moment", default=None)
    preload_n: float | None = quantity("N", "force at the start, positive where it lengthens", default=None)
    preload_nm: float | None = quantity("N m", "moment at the start, positive where it turns on", default=None)
    table_m_n: TableRows | None = table(
        "m, N",
        "progressive spring: length or travel, and force, positive where it lengthens; its last slopes go on",
        default=None,
    )
    table_deg_nm: TableRows | None = table(
        "deg, N m",
        "progressive turning spring: angle, and moment, positive where it turns on; its last slopes go on",
        default=None,
    )
    gas: GasCharge | None = choice("gas instead of a spring: positive where it lengthens", default=None)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        one_of(self, "between", "joint")
        turning = ("rate_nm_per_rad", "table_deg_nm") if self.between is None else ()
        law = one_of(self, "rate_n_per_m", "table_m_n", *turning, "gas")
        starts = {"rate_n_per_m": ("free_m", "preload_n"), "rate_nm_per_rad": ("free_deg", "preload_nm")}.get(law, ())
        if starts:
            one_of(self, *starts)
            if getattr(self, law) == 0.0 and getattr(self, starts[1]):
                raise ValueError(f"{starts[1]} needs {law} above 0; a force that is constant is one of loads")
        only(self, law, (law,), ("between", "joint", *starts))
        if self.between is not None and self.gas is not None and self.gas.area_m2 < 0.0:
            raise ValueError("gas.area_m2 between points must be above 0")
        return self

    @property
    def turns(self) -> bool:
        """Whether it is a turning spring."""
        return self.rate_nm_per_rad is not None or self.table_deg_nm is not None


class Damper(Parameters):
    """A viscous damper between two points, or of a joint."""

    between: tuple[str, str] | None = choice("the two points", default=None)
    joint: str | None = choice("joint along which it acts", default=None)
    rate_ns_per_m: float | None = quantity("N s/m", "force per speed", live=True, default=None, ge=0.0)
    rate_nms_per_rad: float | None = quantity("N m s/rad", "moment per angular speed", live=True, default=None, ge=0.0)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        one_of(self, "between", "joint")
        one_of(self, "rate_ns_per_m", "rate_nms_per_rad")
        if self.between is not None and self.rate_ns_per_m is None:
            raise ValueError("a damper between points needs the key rate_ns_per_m")
        return self

    @property
    def turns(self) -> bool:
        """Whether it is a turning damper."""
        return self.rate_nms_per_rad is not None


class Reset(Parameters):
    """A joint that is again as it starts, each time a revolute comes to an angle: a part is fed, a tool taken back."""

    joint: str = choice("joint that is again as it starts: its place, its speed; no loop or speed may lead it")
    by: str = choice("revolute whose angle tells when, each turn, either way")
    at_deg: float = quantity("deg", "that angle", ge=-360.0, le=360.0)


class FrictionElement(Parameters):
    """Coulomb friction of a joint; a joint at rest sticks as long as the force is smaller."""

    joint: str = choice("joint that rubs")
    coulomb_n: float | None = quantity("N", "friction of a slider", live=True, default=None, ge=0.0)
    coulomb_nm: float | None = quantity("N m", "friction of a revolute", live=True, default=None, ge=0.0)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        one_of(self, "coulomb_n", "coulomb_nm")
        return self

    @property
    def turns(self) -> bool:
        """Whether it is of a turning joint."""
        return self.coulomb_nm is not None
