# SPDX-License-Identifier: Apache-2.0
"""One instance of a unit in FMPy, by the names of its variables."""

from __future__ import annotations

import shutil
from ctypes import byref
from pathlib import Path

import fmpy
from fmpy import calloc, free
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy


class Slave:
    """One instance in FMPy, by the names of its variables."""

    def __init__(self, file: Path) -> None:
        description = fmpy.read_model_description(str(file))
        self._folder = fmpy.extract(str(file))
        self._references = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid, unzipDirectory=self._folder, instanceName="one",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        self.said: list[str] = []
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(lambda *words: self.said.append(words[-1].decode()))
        self._callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        self._callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(self._callbacks))  # FMPy has one for all, and keeps the last, also if it is gone
        self.fmu.instantiate(callbacks=self._callbacks)
        self.fmu.setupExperiment(startTime=0.0)

    def begin(self) -> None:
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def step(self, time_s: float, step_s: float = 0.001) -> None:
        self.fmu.doStep(time_s, step_s)

    def get(self, name: str) -> float:
        return self.fmu.getReal([self._references[name]])[0]

    def set(self, name: str, value: float) -> None:
        self.fmu.setReal([self._references[name]], [value])

    def set_truth(self, name: str, value: bool) -> None:
        self.fmu.setBoolean([self._references[name]], [value])

    def __enter__(self) -> Slave:
        return self

    def __exit__(self, *_: object) -> None:
        self.fmu.freeInstance()
        shutil.rmtree(self._folder)
