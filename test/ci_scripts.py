# SPDX-License-Identifier: Apache-2.0
"""The scripts of ``.ci``, which is no package, as modules."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

PLACE = Path(__file__).resolve().parents[1] / ".ci"


def ci_script(name: str) -> ModuleType:
    """Return a script by its name without ending."""
    spec = importlib.util.spec_from_file_location(name, PLACE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
