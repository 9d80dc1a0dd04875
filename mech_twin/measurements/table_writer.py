# SPDX-License-Identifier: Apache-2.0
"""Readings of sensors as a table: a row an instant, an empty cell where a channel was not sampled then."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.sensors import Reading
from mech_twin.measurements.tables import TIME_COLUMN
from mech_twin.measurements.units import TIME_UNITS
from mech_twin.process.dependencies import require_extra

ROWS_PER_BATCH = 1 << 16
WRITTEN_SUFFIXES = (".parquet", ".csv", ".tsv")


class TableWriter:
    """A table in progress; rows are written in batches, in order of time.

    Parameters
    ----------
    path : Path
        File to write: Parquet, CSV or TSV.
    columns : sequence of str
        Columns beside the time.
    time_column, time_factor : str, float
        Name of the time's column, and how many seconds one of its unit is.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], time_column: str = TIME_COLUMN, time_factor: float = 1.0
    ) -> None:
        self._columns = (time_column, *columns)
        self._place = {name: place for place, name in enumerate(self._columns)}
        self._factor = time_factor
        self._rows: list[list[float | None]] = []
        self._last_s: float | None = None
        self._parquet: Any = None
        self._stream: IO[str] | None = None
        if path.suffix == ".parquet":
            require_extra("tables")
            import pyarrow as pa
            from pyarrow import parquet

            self._schema = pa.schema([(name, pa.float64()) for name in self._columns])
            self._parquet = parquet.ParquetWriter(path, self._schema, compression="zstd")
        else:
            self._stream = path.open("w", newline="", encoding="utf-8")
            self._csv = csv.writer(self._stream, delimiter="\t" if path.suffix == ".tsv" else ",")
            self._csv.writerow(self._columns)

    def __enter__(self) -> TableWriter:
        """Return the writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write what is left and close the file."""
        self._flush()
        if self._parquet is not None:
            self._parquet.close()
        if self._stream is not None:
            self._stream.close()

    def write(self, time_s: float, values: Sequence[tuple[str, float]]) -> None:
        """Add values at an instant; those of the same instant share a row."""
        if time_s != self._last_s:
            if len(self._rows) >= ROWS_PER_BATCH:
                self._flush()
            self._rows.append([time_s / self._factor, *[None] * (len(self._columns) - 1)])
            self._last_s = time_s
        for name, value in values:
            self._rows[-1][self._place[name]] = value

    def read(self, reading: Reading) -> None:
        """Add a reading of sensors."""
        self.write(reading.time_s, list(zip((source.label for source in reading.sources), reading.values, strict=True)))

    def _flush(self) -> None:
        rows, self._rows, self._last_s = self._rows, [], None
        if self._parquet is not None and rows:
            import pyarrow as pa

            arrays = [pa.array(column, pa.float64()) for column in zip(*rows, strict=True)]
            self._parquet.write_batch(pa.RecordBatch.from_arrays(arrays, schema=self._schema))
        elif rows:
            self._csv.writerows([["" if cell is None else repr(cell) for cell in row] for row in rows])


def sensor_table(path: Path, sensors: MeasurementMap) -> TableWriter:
    """Return the writer of the table that shows the channels of a sensors file, which is the map of the table too."""
    columns = [channel.source.label for channel in sensors.channels]
    return TableWriter(path, columns, sensors.time.column or TIME_COLUMN, TIME_UNITS[sensors.time.unit])
