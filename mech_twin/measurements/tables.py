# SPDX-License-Identifier: Apache-2.0
"""Tables as measurements: CSV, TSV and Parquet, read block by block."""

from __future__ import annotations

import csv
import re
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches
from io import SEEK_END, TextIOWrapper
from itertools import islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mech_twin.errors import MeasurementError
from mech_twin.files.input_file import TABLE_SUFFIXES, opened_input
from mech_twin.measurements.blocks import EPOCH_S, NO_DELAYS, Array, Block, SourceColumn
from mech_twin.measurements.measurement_map import TIME_COLUMN, Source, TimeSource
from mech_twin.measurements.units import TIME_UNITS, is_unit, time_unit_in, unit_in
from mech_twin.process.dependencies import require_extra

if TYPE_CHECKING:
    import pyarrow as pa

PARQUET_MAGIC = b"PAR1"
BAG_SUFFIXES = (".mcap", ".db3")
BAG_MAGICS = (b"\x89MCAP", b"SQLite format 3")
HEAD_BYTES = 1 << 16
BLOCK_BYTES = 1 << 20
BATCH_ROWS = 1 << 16
NO_VALUE = ("", "-", "--", "---", "na", "n/a", "#n/a", "null", "none")  # in any case, with a blank at either end
ROW = re.compile(r"Row #(\d+)")
CASES = [case(word) for word in NO_VALUE for case in (str.lower, str.upper, str.title)]
SPELLINGS = [f"{before}{word}{after}" for word in CASES for before in ("", " ") for after in ("", " ")]
WRONG_CELL = re.compile(r"CSV column #(\d+): line (\d+): CSV conversion error to ([a-z]+).*? '(.*)'", re.DOTALL)
INSTANT = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?(Z|[+-]\d\d(?::?\d\d)?)?")  # of ISO 8601
EXPECTED_INSTANT = "a time such as 2026-01-05T12:00:00.25"
MOST_NAMED = 12  # columns listed in an error message


def is_table(path: Path) -> bool:
    """Return whether a file is a table: not one named as a recording, else by its content, or unread by its suffix."""
    if path.is_dir() or path.suffix.lower() in BAG_SUFFIXES:
        return False
    try:
        head = _head(path)
    except OSError:
        return path.suffix.lower() in TABLE_SUFFIXES
    if path.suffix.lower() in TABLE_SUFFIXES and not head.startswith(BAG_MAGICS):
        return True
    return head.startswith(PARQUET_MAGIC) or (b"\x00" not in head and bool(head.strip()))


def _head(path: Path) -> bytes:
    with opened_input(path) as stream:
        return stream.read(HEAD_BYTES)


class TableReader:
    """A table open for reading, CSV, TSV or Parquet; only the requested columns are converted.

    Parameters
    ----------
    path : Path
        CSV (comma, semicolon or tab between the cells), TSV or Parquet file; without a header, columns are 1, 2, 3...
    """

    def __init__(self, path: Path) -> None:
        require_extra("tables")
        self.path = path
        if not path.is_file():
            raise MeasurementError(path, "there is no such table")
        try:
            head = _head(path)
        except OSError as error:
            raise MeasurementError(path, f"cannot be read ({error.strerror})") from error
        is_parquet = head.startswith(PARQUET_MAGIC) or path.suffix.lower() == ".parquet"
        self._text = None if is_parquet else _TextForm(path, head)
        types = self._text.types if self._text else {each.name: each.type for each in self._parquet().schema_arrow}
        self.columns = tuple(types)
        self._clocks = {name: kind.unit for name, kind in types.items() if _is_time(kind)}
        if not self.columns:
            raise MeasurementError(path, "has no columns")

    def offered(self) -> list[SourceColumn]:
        """Return every column except that of time, with the unit in its header."""
        time = self.proposed_time().column
        return [SourceColumn(Source(column=name), unit_in(name)) for name in self.columns if name != time]

    def proposed_time(self) -> TimeSource:
        """Return the first column named as a time; else the first typed or ascending as one; else the first.

        Raises
        ------
        MeasurementError
            That column has a unit that is none of time.
        """
        names = [(name, name.strip("%# ").lower()) for name in self.columns]
        named = next((name for name, word in names if word.startswith(("time", "stamp")) or word in ("t", "t_s")), None)
        column = named or next((name for name, word in names if time_unit_in(word) is not None), None)
        if column is None:
            rising = (*self._clocks, *(self._text.rising if self._text else ()))
            column = rising[0] if rising else self.columns[0]
            if (unit := unit_in(column)) not in (None, "1", "count"):
                expected = f"expected a column of the time, named such as 'time' or 't_ms'; {column!r} is in {unit}"
                raise MeasurementError(self.path, expected)
        unit = self._clocks.get(column) or time_unit_in(column) or self._unit_since_1970(column)
        return TimeSource(column=column, unit=unit or "s")

    def _unit_since_1970(self, column: str) -> str | None:
        """Return the unit by which a first stamp is a time of this century or the next; None for other stamps."""
        batch = next(self._batches([column]), None)
        first = np.nan if batch is None or not batch.num_rows else _numbers(batch[column], self.path, column)[0][0]
        return next((unit for unit, size in TIME_UNITS.items() if size <= 1.0 and 1e9 <= first * size < 5e9), None)

    def blocks(self, sources: Sequence[Source], time: TimeSource) -> Iterator[Block]:
        """Yield the samples of these columns; see `RunReader.blocks`."""
        names = [self._column(source.column or source.label) for source in sources]
        clock = self._column(time.column or TIME_COLUMN)
        factor, origin = TIME_UNITS[self._clocks.get(clock, time.unit)], None
        for batch in self._batches(list(dict.fromkeys((clock, *names)))):
            times, known = _numbers(batch[clock], self.path, clock)
            stamped = known & np.isfinite(times)
            if origin is None and stamped.any():
                first_s = float(times[stamped][0]) * factor
                origin = round(np.floor(first_s) / factor) if abs(first_s) > EPOCH_S else 0
            stamps = np.where(stamped, _numbers(batch[clock], self.path, clock, origin or 0)[0] * factor, np.nan)
            for place, name in enumerate(names):
                values, known = _numbers(batch[name], self.path, name)
                yield Block(place, stamps[known], values[known], NO_DELAYS)

    def _column(self, name: str) -> str:
        """Return the column of this name; ``%``, ``#`` and blanks around names are ignored."""
        bare = {column.strip("%# \t\ufeff"): column for column in self.columns}
        found = name if name in self.columns else bare.get(name.strip("%# \t\ufeff"))
        if found is not None:
            return found
        near = get_close_matches(name, self.columns, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        listed = ", ".join(repr(column) for column in self.columns[:MOST_NAMED])
        raise MeasurementError(self.path, f"has no column {name!r}; expected one of {listed}{hint}")

    def _parquet(self) -> Any:
        import pyarrow as pa
        from pyarrow import parquet

        try:
            return parquet.ParquetFile(self.path)
        except (pa.ArrowException, OSError) as error:
            raise MeasurementError(self.path, f"cannot be read as Parquet ({_first_line(error)})") from error

    def _batches(self, names: list[str]) -> Iterator[pa.RecordBatch]:
        import pyarrow as pa

        try:
            if self._text is None:
                yield from self._parquet().iter_batches(batch_size=BATCH_ROWS, columns=names)
            else:
                yield from self._text.batches(names)
        except (pa.ArrowException, OSError) as error:
            text = str(error) if self._text is None else self._text.explained(str(error))
            raise MeasurementError(self.path, f"cannot be read as a table: {_first_line(text)}") from error


class _TextForm:
    """Format of a text table: delimiter, decimal sign, names of the columns."""

    def __init__(self, path: Path, head: bytes) -> None:
        self._path = path
        head = head.rstrip(b"\x00")  # a file system may leave them where power failed
        if b"\x00" in head:
            raise MeasurementError(path, "is no text; expected a table of numbers with a header line")
        lines = _decoded(head).splitlines(keepends=True)
        if len(head) == HEAD_BYTES:
            lines = lines[:-1]
        if not lines:
            raise MeasurementError(path, "is empty" if not head else f"has no line end in {HEAD_BYTES} bytes")
        self._delimiter = _delimiter(lines)
        reader = csv.reader(lines, delimiter=self._delimiter)
        ends, every = zip(*((reader.line_num, row) for row in reader), strict=True)  # a name in quotes may have lines
        rows = every[:50]
        first = next((i for i, row in enumerate(rows) if _most(row, _is_read)), None)
        if first is None:
            expected = f"expected numbers, or {EXPECTED_INSTANT}, with comma, semicolon or tab between them"
            raise MeasurementError(path, f"has no line of numbers in most cells in its first 50 lines; {expected}")
        self._skipped = (0, *ends)[first]
        cells = len(rows[first])
        data = (cell for row in every[first:] for cell in row)
        comma = self._delimiter != "," and any("," in cell and _is_number(cell) for cell in data)
        self._decimal = "," if comma else "."
        names = _names(rows[:first])
        if any(name and name[0] not in "%#" for name in names[cells:]):  # a remark ends the line of names
            expected = "expected a cell for each name"
            raise MeasurementError(path, f"line {ends[first]}: {cells} cells under {len(names)} names; {expected}")
        names += [f"{i + 1}" for i in range(len(names), cells)]
        columns = [
            name if name and name not in names[:i] else f"{name or 'column'} {i + 1}"
            for i, name in enumerate(names[:cells])
        ]
        below = {name: [row[i].strip() for row in rows[first:] if len(row) > i] for i, name in enumerate(columns)}
        self.types = {name: _type_of(column) for name, column in below.items()}
        self.rising = tuple(name for name, column in below.items() if _rises(column))

    def batches(self, names: list[str]) -> Iterator[pa.RecordBatch]:
        """Yield these columns by their types, batch by batch."""
        from pyarrow import csv as arrow_csv

        cut = self._unended_line()
        reader = arrow_csv.open_csv(
            self._path,
            read_options=arrow_csv.ReadOptions(
                use_threads=False, block_size=BLOCK_BYTES, skip_rows=self._skipped, column_names=list(self.types)
            ),
            parse_options=arrow_csv.ParseOptions(
                delimiter=self._delimiter,
                ignore_empty_lines=True,
                invalid_row_handler=lambda row: "skip" if row.text == cut else "error",
            ),
            convert_options=arrow_csv.ConvertOptions(
                include_columns=names,
                column_types={name: self.types[name] for name in names},
                null_values=SPELLINGS,
                decimal_point=self._decimal,
            ),
        )
        with reader:
            yield from reader

    def _unended_line(self) -> str | None:
        """Return the last line of the file if no line end follows: one with too few cells was cut while written."""
        with opened_input(self._path) as stream:
            stream.seek(-min(HEAD_BYTES, stream.seek(0, SEEK_END)), SEEK_END)
            return re.split(r"[\r\n]", stream.read().decode("utf-8", "replace"))[-1] or None

    def explained(self, error: str) -> str:
        """Return the message for an Arrow error, with column and line if it is about a cell."""
        text = ROW.sub(lambda row: f"line {self._line(int(row[1]))}", error)
        found = WRONG_CELL.search(text)
        if found is None:
            return text
        column, line, kind, value = found.groups()
        zoned = f"{EXPECTED_INSTANT} without blanks, with a zone if the first one has it"
        number = f"a number with decimal sign {self._decimal!r}, or in all lines {EXPECTED_INSTANT}"
        expected = f"a word such as n/a, {zoned if kind == 'timestamp' else number}"
        return f"column {list(self.types)[int(column)]!r}, line {line}, value {value!r}: expected {expected}"

    def _line(self, row: int) -> int:
        """Return the line of a row as Arrow counts rows: each line above the numbers, then all that are not empty."""
        with TextIOWrapper(opened_input(self._path), encoding="latin-1") as text:
            counted = (line for line, content in enumerate(text, 1) if line <= self._skipped or content != "\n")
            return next(islice(counted, row - 1, None), row)


def _decoded(head: bytes) -> str:
    """Return the head as text: UTF-8, whose last sign may be cut, else the encoding of Windows."""
    try:
        return getincrementaldecoder("utf-8-sig")().decode(head)
    except UnicodeDecodeError:
        return head.decode("cp1252", "replace")


def _delimiter(lines: list[str]) -> str:
    """Return the delimiter, from the middle line; a comma may be the decimal sign beside others."""
    line = lines[len(lines) // 2]
    return next((sign for sign in "\t;" if sign in line), ",")


def _most(row: list[str], test: Callable[[str], bool]) -> bool:
    """Return whether more than half of the cells with a value pass a test."""
    cells = [cell.strip() for cell in row if cell.strip().lower() not in NO_VALUE]
    return sum(map(test, cells)) > len(cells) / 2


def _names(above: Sequence[list[str]]) -> list[str]:
    """Return the names in the last row with any above the numbers; those above a row of units, with the units."""
    filled = [[" ".join(map(str.strip, cell.splitlines())).strip() for cell in row] for row in above if any(row)]
    *others, names = [row for row in filled if any(row)] or [[]]
    if not (others and len(others[-1]) == len(names) and _most(names, is_unit)):
        return names
    return [f"{name} [{unit.strip('()[]')}]" if unit else name for name, unit in zip(others[-1], names, strict=True)]


def _rises(cells: list[str]) -> bool:
    numbers = [float(cell.replace(",", ".")) for cell in cells if _is_number(cell)]
    return len(numbers) > 1 and all(after > before for before, after in pairwise(numbers))


def _type_of(cells: list[str]) -> Any:
    """Return the Arrow type of a column of text: of time, with a zone or without, if its first value is an instant."""
    import pyarrow as pa

    found = INSTANT.fullmatch(next((cell for cell in cells if cell.lower() not in NO_VALUE), ""))
    return pa.timestamp("ns", "UTC" if found[1] else None) if found else pa.float64()


def _is_read(cell: str) -> bool:
    return _is_number(cell) or INSTANT.fullmatch(cell) is not None


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _is_time(kind: Any) -> bool:
    """Return whether the type of a column is one of time, which knows its unit."""
    import pyarrow as pa

    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))


def _numbers(column: Any, path: Path, name: str, origin: int = 0) -> tuple[Array, Any]:
    """Return a column less an origin as floats, and a mask of the cells with a value; of whole numbers exactly."""
    import pyarrow as pa
    from pyarrow import compute

    if _is_time(column.type):
        column = column.cast(pa.int64())
    kinds = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean, pa.types.is_decimal)
    if not any(known(column.type) for known in kinds):
        raise MeasurementError(path, f"column {name!r} holds {column.type}, expected numbers")
    known = ~np.asarray(column.is_null(), dtype=bool)
    if origin and pa.types.is_integer(column.type):  # nanoseconds since 1970 have more digits than a float
        column, origin = compute.subtract(column.cast(pa.int64(), safe=False), origin), 0
    return np.asarray(column.cast(pa.float64(), safe=False).fill_null(0.0), dtype=np.float64) - origin, known


def _first_line(error: Exception | str) -> str:
    return " ".join(str(error).split())[:300]
