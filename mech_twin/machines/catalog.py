# SPDX-License-Identifier: Apache-2.0
"""The machines there are, written out by hand."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from mech_twin.declarations.quantity import Parameters
from mech_twin.roles import Capabilities, Machine


@dataclass(frozen=True)
class Entry:
    """One machine of the catalogue: its name, a description, and its package.

    The package is imported on first use, so that listing the machines compiles nothing.  It defines
    ``PARAMETERS`` (the parameter model) and ``build(parameters) -> Machine``; a machine that answers more than a run
    defines ``capabilities() -> Capabilities`` too.
    """

    name: str
    title: str
    has_body: bool = False  # whether more than the linkage moves
    kernels: int = (
        0  # that a first run compiles, rounded up to tens; what other machines left in the cache is not compiled
    )

    def _module(self) -> Any:
        return import_module(f"mech_twin.machines.{self.name}")

    @property
    def parameters(self) -> type[Parameters]:
        """The parameter model of the machine."""
        model: type[Parameters] = self._module().PARAMETERS
        return model

    def build(self, parameters: Parameters) -> Machine:
        """Return the machine of these parameters."""
        if not isinstance(parameters, self.parameters):
            raise TypeError(f"expected {self.parameters.__name__} parameters, got {type(parameters).__name__}")
        machine: Machine = self._module().build(parameters)
        return machine

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the machine besides running; empty if its package defines none."""
        declared: Callable[[], Capabilities] | None = getattr(self._module(), "capabilities", None)
        return Capabilities() if declared is None else declared()


def usual_capabilities(metrics: Any, published: Any, sizing: Any = None, **further: Any) -> Capabilities:
    """Return what modules of a machine answer under the usual names, and further capabilities by theirs."""
    from mech_twin.capabilities.sizing import SizingQuestion

    found = {name: getattr(metrics, name, None) for name in ("features", "faults", "operating")}
    found |= {"published": published.rows, "pictures": getattr(published, "pictures", None)}
    if sizing is not None:
        found["sizing"] = SizingQuestion(sizing.LIMITS, sizing.OBJECTIVES, sizing.sizing, sizing.USUAL_TOLERANCE)
    return Capabilities(**{**found, **further})


CATALOGUE = {
    entry.name: entry
    for entry in (
        Entry(
            "mb10_breaker", "MB-10 breaker with the MO-10 percussion mechanism and its spring-pressed body", True, 220
        ),
        Entry("compaction_press", "four-bar shock-vibration compaction press", kernels=190),
        Entry("vibration_crank", "crank vibration mechanism with counterweight", kernels=160),
        Entry("impact_mass", "mass under a two-level periodic force, with a stop", kernels=70),
        Entry("roller_former", "roller forming installation, 1 to 4 carts on one crank shaft", kernels=180),
        Entry("winding_drum", "winding drum with an ideal or eccentric package", kernels=140),
    )
}
