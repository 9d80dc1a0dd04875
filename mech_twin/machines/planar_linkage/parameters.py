# SPDX-License-Identifier: Apache-2.0
"""Parameters of a planar linkage of one's own: a crank, up to four dyads, masses, loads, springs, a working stroke."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import hypot
from typing import Any, Literal

from pydantic import model_validator

from mech_twin.engine.coupling import Coupling
from mech_twin.machines.drives import DrivenCrank
from mech_twin.parts.supply import SupplyParameters
from mech_twin.quantity import Parameters, choice, quantity

GRAVITY = 9.80665
LONGEST_M = 100.0
USUAL_STEP_S = 0.0005  # 1.8 degrees of a crank at 600 rpm
LinkName = Literal[
    "ground", "crank", "dyad_1_first", "dyad_1_second", "dyad_2_first", "dyad_2_second", "dyad_3_first",
    "dyad_3_second", "dyad_4_first", "dyad_4_second",
]  # fmt: skip
LINK_NAMES: tuple[str, ...] = LinkName.__args__  # type: ignore[attr-defined]
FROM_X = "point of from_link where the first link's pin A is, along it; the link's end where absent"


def _place(meaning: str, **options: Any) -> float:
    place: float = quantity("m", meaning, ge=-LONGEST_M, le=LONGEST_M, **options)
    return place


class MovingLink(Parameters):
    """Mass of a link; a link without mass where the group is absent."""

    mass_kg: float = quantity("kg", "mass", ge=0.0, le=1e6)
    inertia_kg_m2: float = quantity("kg m2", "inertia about the centre of mass", default=0.0, ge=0.0, le=1e8)
    centre_x_m: float = _place("centre of mass in the link's frame, along the link", default=0.0)
    centre_y_m: float = _place("centre of mass in the link's frame, across the link, to the left", default=0.0)


class CrankLink(Parameters):
    """The crank, in its bearing at the machine's origin."""

    length_m: float = quantity("m", "crank from its bearing to its pin", ge=1e-3, le=LONGEST_M)
    mass: MovingLink | None = choice("mass of the crank", default=None)
    flywheel_kg_m2: float = quantity("kg m2", "inertia of a flywheel on the crank shaft", default=0.0, ge=0.0, le=1e8)


class Dyad(Parameters):
    """Two links that hang on links before them by A and B, and make no freedom of their own."""

    kind: Literal["rrr", "rrp", "rpr"] = choice(
        "two links with a pin (rrr), a link with a slider on a guide (rrp), a block in A that slides on a bar (rpr)"
    )
    from_link: LinkName = choice("link that carries pin A of the first link (of the block, in an rpr)")
    from_x_m: float | None = quantity("m", FROM_X, default=None, ge=-LONGEST_M, le=LONGEST_M)
    from_y_m: float = _place("pin A across from_link", default=0.0)
    to_link: LinkName = choice("link that carries pin B of the second link, or the guide", default="ground")
    to_x_m: float = _place("pin B, or a point of the guide, along to_link", default=0.0)
    to_y_m: float = _place("pin B, or a point of the guide, across to_link", default=0.0)
    first_m: float | None = quantity("m", "length of the first link (rrr, rrp)", default=None, ge=1e-3, le=LONGEST_M)
    second_m: float | None = quantity(
        "m", "length of the second link (rrr); of the bar, for what hangs on its end (rpr)",
        default=None, ge=1e-3, le=LONGEST_M,
    )  # fmt: skip
    guide_deg: float = quantity(
        "deg", "direction of the guide against to_link, counter-clockwise (rrp)", default=0.0, ge=-360.0, le=360.0
    )
    branch: Literal["plus", "minus"] = choice(
        "how it is assembled: pin C left of A to B (rrr) or slider ahead of A (rrp) for plus, else minus",
        default="plus",
    )
    first: MovingLink | None = choice("mass of the first link, or of the block", default=None)
    second: MovingLink | None = choice("mass of the second link, of the slider or of the bar", default=None)

    @model_validator(mode="after")
    def _sizes_of_its_kind(self) -> Dyad:
        needed = {"rrr": ("first_m", "second_m"), "rrp": ("first_m",), "rpr": ()}[self.kind]
        unused = {"rrr": (), "rrp": ("second_m",), "rpr": ("first_m",)}[self.kind]
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f"kind {self.kind} needs the key {key}")
        for key in unused:
            if getattr(self, key) is not None:
                raise ValueError(f"kind {self.kind} has no {key}: leave it out")
        return self


class ConstantForce(Parameters):
    """Force that stays as it is, in direction and size."""

    link: LinkName = choice("link that it acts on")
    x_m: float = _place("point of the link, along it")
    y_m: float = _place("point of the link, across it", default=0.0)
    force_x_n: float = quantity("N", "force to the right", default=0.0, ge=-1e8, le=1e8, live=True)
    force_y_n: float = quantity("N", "force upward", default=0.0, ge=-1e8, le=1e8, live=True)


class Spring(Parameters):
    """Spring between a point of a link and the ground."""

    link: LinkName = choice("link that it pulls")
    x_m: float = _place("point of the link, along it")
    y_m: float = _place("point of the link, across it", default=0.0)
    ground_x_m: float = _place("its end on the ground, to the right of the crank bearing")
    ground_y_m: float = _place("its end on the ground, above the crank bearing")
    rate_n_per_m: float = quantity("N/m", "spring rate", ge=0.0, le=1e9, live=True)
    free_m: float = quantity("m", "length without force", ge=0.0, le=LONGEST_M)


class WorkingStrokeGroup(Parameters):
    """Force against a point of a link while that goes one way; the other way, and on what is worked, there is none."""

    link: LinkName = choice("link that carries the tool")
    x_m: float = _place("point of the link, along it", default=0.0)
    y_m: float = _place("point of the link, across it", default=0.0)
    direction_deg: float = quantity("deg", "direction of the stroke, from +x counter-clockwise", ge=-360.0, le=360.0)
    force_n: float = quantity("N", "force against the stroke", ge=0.0, le=1e8, live=True)


class PlanarLinkageParameters(DrivenCrank):
    """Parameters of the planar linkage."""

    crank: CrankLink = choice("the crank")
    dyad_1: Dyad = choice("first dyad")
    dyad_2: Dyad | None = choice("second dyad", default=None)
    dyad_3: Dyad | None = choice("third dyad", default=None)
    dyad_4: Dyad | None = choice("fourth dyad", default=None)
    load_1: ConstantForce | None = choice("a constant force", default=None)
    load_2: ConstantForce | None = choice("a constant force", default=None)
    load_3: ConstantForce | None = choice("a constant force", default=None)
    spring_1: Spring | None = choice("a spring to the ground", default=None)
    spring_2: Spring | None = choice("a spring to the ground", default=None)
    working_stroke: WorkingStrokeGroup | None = choice("force against the stroke of a tool", default=None)
    supply: SupplyParameters = choice(
        "supply of the drive", default=SupplyParameters(initial_fraction=1.0, rate_per_s=2.0)
    )
    coupling: Coupling = choice("coupling of the roles", default=Coupling(step_s=USUAL_STEP_S))
    gravity_m_per_s2: float = quantity(
        "m/s2", "gravity, downward; 0 for a flat table", default=GRAVITY, ge=0.0, le=100.0
    )

    @property
    def dyads(self) -> dict[str, Dyad]:
        """The dyads by their keys, in order."""
        named = {"dyad_1": self.dyad_1, "dyad_2": self.dyad_2, "dyad_3": self.dyad_3, "dyad_4": self.dyad_4}
        return {key: dyad for key, dyad in named.items() if dyad is not None}

    @property
    def loads(self) -> tuple[ConstantForce, ...]:
        """The constant forces."""
        return tuple(load for load in (self.load_1, self.load_2, self.load_3) if load is not None)

    @property
    def springs(self) -> tuple[Spring, ...]:
        """The springs."""
        return tuple(spring for spring in (self.spring_1, self.spring_2) if spring is not None)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, the ground first."""
        return LINK_NAMES[: 2 + 2 * len(self.dyads)]

    @property
    def masses(self) -> Mapping[str, MovingLink | None]:
        """Mass of every moving link by name."""
        found: dict[str, MovingLink | None] = {"crank": self.crank.mass}
        for key, dyad in self.dyads.items():
            found |= {f"{key}_first": dyad.first, f"{key}_second": dyad.second}
        return found

    def length_m(self, link: str) -> float:
        """Return the length of a link, 0 where its end is its origin (ground, sliders, blocks)."""
        if link in ("ground", "crank"):
            return self.crank.length_m if link == "crank" else 0.0
        dyad = self.dyads[link[:6]]
        return (dyad.first_m if link.endswith("first") else dyad.second_m) or 0.0

    @model_validator(mode="after")
    def _dyads_follow_each_other(self) -> PlanarLinkageParameters:
        for later, earlier in ((self.dyad_2, "dyad_1"), (self.dyad_3, "dyad_2"), (self.dyad_4, "dyad_3")):
            if later is not None and earlier not in self.dyads:
                raise ValueError(f"{earlier} is missing: dyads are numbered without a gap")
        known = ["ground", "crank"]
        for key, dyad in self.dyads.items():
            for name, link in (("from_link", dyad.from_link), ("to_link", dyad.to_link)):
                if link not in known:
                    raise ValueError(f"{key}.{name} = {link}: expected a link before it, one of {', '.join(known)}")
            if dyad.from_link == dyad.to_link:
                raise ValueError(f"{key}.to_link = {dyad.to_link}: expected another link than from_link")
            known += [f"{key}_first", f"{key}_second"]
        return self

    @model_validator(mode="after")
    def _what_is_loaded_moves(self) -> PlanarLinkageParameters:
        moving = self.links[1:]
        for name, link in self._loaded():
            if link not in moving:
                raise ValueError(f"{name}.link = {link}: expected a moving link, one of {', '.join(moving)}")
        if not any(mass is not None and mass.mass_kg > 0.0 for mass in self.masses.values()):
            raise ValueError("expected a mass on at least one link (crank.mass, dyad_1.first, dyad_1.second, ...)")
        return self

    @model_validator(mode="after")
    def _crank_turns(self) -> PlanarLinkageParameters:
        from mech_twin.machines.planar_linkage.assembly import check_turn

        check_turn(self)
        return self

    def _loaded(self) -> Iterator[tuple[str, str]]:
        for i, load in enumerate((self.load_1, self.load_2, self.load_3), 1):
            if load is not None:
                yield f"load_{i}", load.link
        for i, spring in enumerate((self.spring_1, self.spring_2), 1):
            if spring is not None:
                yield f"spring_{i}", spring.link
        if self.working_stroke is not None:
            yield "working_stroke", self.working_stroke.link

    @property
    def size_m(self) -> float:
        """Size of the linkage: the sum of its lengths and distances."""
        sizes = [self.crank.length_m]
        for dyad in self.dyads.values():
            sizes += [dyad.first_m or 0.0, dyad.second_m or 0.0, hypot(dyad.to_x_m, dyad.to_y_m)]
            sizes.append(hypot(dyad.from_x_m or 0.0, dyad.from_y_m))
        return sum(sizes)
