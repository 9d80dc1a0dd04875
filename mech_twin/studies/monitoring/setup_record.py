# SPDX-License-Identifier: Apache-2.0
"""Validation of a monitor's setup file, which a user may have edited, cut or made with another program.

Each field has its own bounds where it is declared; here are those between fields.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, TypeAdapter

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.baseline import LARGEST_ORDER
from mech_twin.studies.monitoring.diagnosis import Signature
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.operating import OperatingSurface, polynomial_terms

SMALLEST_VARIANCE = 1e-60
LARGEST_BYTES = 64 << 20


def _checked(setup: MonitorSetup) -> MonitorSetup:
    baseline, surface = setup.baseline, setup.operating
    d, names = len(baseline.names), [signature.name for signature in setup.signatures]
    _demand("baseline.names", "each once", 0 < d == len(set(baseline.names)))
    _demand("signatures", "each name once", len(set(names)) == len(names))
    _demand("baseline.coefficients", f"at most {LARGEST_ORDER} rows", baseline.order <= LARGEST_ORDER)
    shapes = [("baseline.mean", baseline.mean, (d,)), ("baseline.covariance", baseline.covariance, (d, d))]
    shapes += [] if surface is None else _shapes_of_surface(surface)
    for signature in setup.signatures:
        shapes += _shapes_of_signature(signature, d, 0 if surface is None else len(surface.variables))
    for name, numbers, shape in shapes:
        _demand(name, f"numbers of the shape {shape}, as many as names", numbers.shape == shape)
    _check_covariance(baseline.covariance)
    for signature in setup.signatures:
        ascending = (np.diff(signature.sizes) > 0.0).all() and 0.0 in signature.sizes and len(signature.sizes) > 1
        _demand(f"sizes of {signature.name!r}", "ascending ones, with 0", bool(ascending))
    if surface is not None:
        slopes = surface.coefficients[: len(surface.variables)][:, list(surface.pivots)]
        apart = abs(np.linalg.det(slopes / np.maximum(np.abs(slopes).max(axis=0), 1e-300))) > 1e-9
        _demand("operating.coefficients", "pivots that tell the variables apart", bool(apart))
        _demand("baseline.names", "those of operating.names that are no pivots", baseline.names == surface.left_names)
    return setup


SETUP: TypeAdapter[MonitorSetup] = TypeAdapter(Annotated[MonitorSetup, AfterValidator(_checked)])


def _demand(name: str, expected: str, holds: bool) -> None:
    if not holds:
        raise ValueError(f"{name}: expected {expected}")


def _shapes_of_surface(surface: OperatingSurface) -> Iterator[tuple[str, Array, tuple[int, ...]]]:
    """Yield name, numbers and shape of the arrays of a surface, whose names and pivots are checked."""
    d, q = len(surface.names), len(surface.variables)
    known = len(set(surface.names)) == d and len(set(surface.pivots)) == len(surface.pivots)
    _demand("operating.names and pivots", f"each once, pivots below {d}", known and max(surface.pivots, default=0) < d)
    one_each = q < d and q == len(surface.beyond) == len(surface.pivots)
    _demand("operating.beyond and pivots", f"{q}, one of each variable, fewer than names", one_each)
    _demand(
        "operating.ranges",
        "numbers above 0, at most 10",
        bool((surface.ranges > 0.0).all() and (surface.ranges <= 10.0).all()),
    )
    shapes = {
        "ranges": (q,), "mean": (d,), "root": (d, d), "coefficients": (len(polynomial_terms(q)), d), "doubt": (d - q,),
        "wander": (q,), "moved": (q,), "transient": (q, d - q), "drift": (d - q,) if len(surface.drift) > 1 else (1,),
    }  # fmt: skip
    yield from ((f"operating.{name}", getattr(surface, name), shape) for name, shape in shapes.items())


def _shapes_of_signature(each: Signature, d: int, q: int) -> Iterator[tuple[str, Array, tuple[int, ...]]]:
    """Yield name, numbers and shape of the arrays of a signature that are not empty."""
    m, factors = len(each.sizes), each.scatter.shape[1] if each.scatter.ndim > 1 else 0
    shapes = {"responses": (m, d), "doubt": (m, d), "points": (m, q), "scatter": (m, factors, d), "sizes": (m,)}
    for name, shape in shapes.items():
        if len(numbers := getattr(each, name)) or name == "responses":
            yield f"{name} of {each.name!r}", numbers, shape


def _check_covariance(covariance: Array) -> None:
    _demand("baseline.covariance", "a symmetric matrix", np.allclose(covariance, covariance.T, rtol=1e-9, atol=0.0))
    spread = np.diag(covariance)
    least = f"variances of at least {SMALLEST_VARIANCE:g}"
    _demand("baseline.covariance", least, bool((spread >= SMALLEST_VARIANCE).all()))
    unit = covariance / np.sqrt(np.outer(spread, spread))
    _demand("baseline.covariance", "a positive definite matrix", bool(np.linalg.eigvalsh(unit)[0] > 0.0))
