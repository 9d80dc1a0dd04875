# SPDX-License-Identifier: Apache-2.0
"""Tables of any dialect give the same numbers, block by block."""

from __future__ import annotations

import csv
import tracemalloc
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import Source, TimeSource
from mech_twin.measurements.tables import TableReader, is_table
from mech_twin.measurements.units import TIME_UNITS

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
pa_csv = pytest.importorskip("pyarrow.csv")
NAMES = ("Time (ms)", "angle (deg)", "force [N]")


def numbers(rows: int = 300) -> Array:
    return (
        np.random.default_rng(7).normal(size=(rows, 3)).round(6) + [[0.0, 0.0, 5.0]] * rows + np.arange(rows)[:, None]
    )


def table(path: Path, rows: Array, names: tuple[str, ...] = NAMES, delimiter: str = ",", decimal: str = ".") -> Path:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, delimiter=delimiter)
        if names:
            writer.writerow(names)
        writer.writerows([[str(cell).replace(".", decimal) for cell in row] for row in rows.tolist()])
    return path


def read(path: Path, names: tuple[str, ...], time: TimeSource) -> list[tuple[Array, Array]]:
    blocks = list(TableReader(path).blocks([Source(column=name) for name in names], time))
    mine = [[block for block in blocks if block.channel == place] for place in range(len(names))]
    return [(np.concatenate([b.times_s for b in of]), np.concatenate([b.values for b in of])) for of in mine]


@pytest.mark.parametrize(
    ("suffix", "delimiter", "decimal"),
    [(".csv", ",", "."), (".csv", ";", "."), (".csv", ";", ","), (".tsv", "\t", "."), (".txt", "\t", ",")],
)
def test_every_dialect_gives_the_same_numbers(suffix: str, delimiter: str, decimal: str, tmp_path: Path) -> None:
    rows = numbers()
    path = table(tmp_path / f"a{suffix}", rows, delimiter=delimiter, decimal=decimal)
    reader = TableReader(path)
    assert reader.columns == NAMES
    assert reader.proposed_time() == TimeSource(column="Time (ms)", unit="ms")
    assert [item.unit for item in reader.offered()] == ["deg", "N"]
    (times, values), (_, forces) = read(path, NAMES[1:], reader.proposed_time())
    assert np.array_equal(values, rows[:, 1])
    assert np.array_equal(forces, rows[:, 2])
    assert np.allclose(times, rows[:, 0] * 1e-3, rtol=1e-15)


def test_parquet_gives_the_numbers_and_leaves_out_empty_cells(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    path = tmp_path / "a.parquet"
    parquet.write_table(pa.table({"t": [0.0, 1.0, 2.0], "x": [1.0, None, float("nan")], "n": [1, 2, 3]}), path)
    (times, values), (_, counted) = read(path, ("x", "n"), TimeSource(column="t"))
    assert times.tolist() == [0.0, 2.0]
    assert values[0] == 1.0
    assert np.isnan(values[1])
    assert counted.tolist() == [1.0, 2.0, 3.0]


def test_decimals_of_a_database_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    cells = [Decimal("0.125"), Decimal("1.25"), None]
    pq.write_table(pa.table({"t": [*cells[:2], Decimal("2.5")], "x": cells}), path)
    ((times, values),) = read(path, ("x",), TimeSource(column="t"))
    assert (times.tolist(), values.tolist()) == ([0.125, 1.25], [0.125, 1.25])


def test_a_decimal_comma_in_any_row_of_the_head_is_the_decimal_sign(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    whole = "".join(f"{i};{2 * i};one, two\n" for i in range(100))
    path.write_text(f"t;x;remark\n{whole}100,5;-3,25;\n", encoding="utf-8")
    ((times, values),) = read(path, ("x",), TimeSource(column="t"))
    assert (times[-1], values[-2], values[-1]) == (100.5, 198.0, -3.25)
    path.write_text("t;x;remark\n0.5;17.5;one, two\n", encoding="utf-8")
    ((times, values),) = read(path, ("x",), TimeSource(column="t"))
    assert (times[0], values[0]) == (0.5, 17.5)


@pytest.mark.parametrize("word", ["n/a", "N/A", " n/a", "#N/A", "NULL", "None", "---", "-", "", "na"])
def test_a_word_for_a_missing_number_is_no_sample_and_no_header(word: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"t,x,y,z\n0,{word},{word},{word}\n1,{word},4,NaN\n2,3,5,7\n", encoding="utf-8")
    (times, _), (_, values), (_, others) = read(path, ("x", "y", "z"), TimeSource(column="t"))
    assert times.tolist() == [2.0]
    assert values.tolist() == [4.0, 5.0]
    assert np.array_equal(others, [np.nan, 7.0], equal_nan=True)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_name_of_several_lines_in_quotes_is_one_name(end: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(end.join(["rig 3,", f'"Time {end}(ms)","angle{end}(deg)"', "0,1", "1,2", ""]), newline="")
    assert TableReader(path).columns == ("Time (ms)", "angle (deg)")
    ((times, values),) = read(path, ("angle (deg)",), TableReader(path).proposed_time())
    assert (times.tolist(), values.tolist()) == ([0.0, 0.001], [1.0, 2.0])


def test_a_row_of_units_stands_behind_the_names_above_it(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("stand 3\ntime,angle,load,note\n[ms],deg,bar,\n0,1,2,\n1,2,3,\n", encoding="utf-8")
    reader = TableReader(path)
    assert reader.columns == ("time [ms]", "angle [deg]", "load [bar]", "note")
    assert reader.proposed_time() == TimeSource(column="time [ms]", unit="ms")
    assert [each.unit for each in reader.offered()] == ["deg", None, None]
    path.write_text("of,stand\nt,x_mm\n0,1\n1,2\n", encoding="utf-8")
    assert TableReader(path).columns == ("t", "x_mm")


@pytest.mark.parametrize("empty", ["", "  ", ",,"])
def test_empty_lines_above_the_numbers_hide_no_header(empty: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{empty}\ntime_s,x_mm\n{empty}\n0,1\n\n1,2\n", encoding="utf-8")
    assert TableReader(path).columns == ("time_s", "x_mm")
    ((times, values),) = read(path, ("x_mm",), TimeSource(column="time_s"))
    assert (times.tolist(), values.tolist()) == ([0.0, 1.0], [1.0, 2.0])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "latin-1"])
@pytest.mark.parametrize("remark", ["x", "xy"])  # the head ends within a sign for one, after it for the other
def test_a_header_is_read_in_utf_8_and_in_the_encoding_of_windows(encoding: str, remark: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    row = f"0,1,{'°' * 999}\n"
    path.write_text(f"t,Winkel [°],{remark}\n{row * 3}{row.replace('°', '°°') * 97}", encoding=encoding)
    reader = TableReader(path)
    assert reader.columns == ("t", "Winkel [°]", remark)
    assert [each.unit for each in reader.offered()] == ["deg", None]
    ((_, values),) = read(path, ("Winkel [°]",), TimeSource(column="t"))
    assert len(values) == 100


@pytest.mark.parametrize("kind", [pa.timestamp, pa.duration])
@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_a_typed_time_counts_in_its_own_unit_whatever_the_map_says(kind: Any, unit: str, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    counts = [round(seconds / TIME_UNITS[unit]) for seconds in (1.0, 2.0, 4.0)]
    columns = {"x": [5.0, 4.0, 7.0], "logged at": pa.array(counts, kind(unit))}
    pq.write_table(pa.table(columns), path)
    assert TableReader(path).proposed_time() == TimeSource(column="logged at", unit=unit)
    for named in TIME_UNITS:
        ((times, _),) = read(path, ("x",), TimeSource(column="logged at", unit=named))
        assert times.tolist() == pytest.approx([1.0, 2.0, 4.0], rel=1e-15)


@pytest.mark.parametrize("between", ["T", " "])
@pytest.mark.parametrize("zones", [("", "", ""), ("Z", "+00", "+01:00")])
def test_text_instants_are_the_time_to_the_nanosecond(between: str, zones: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    instants = [f"2026-11-03{between}{clock}" for clock in ("07:59:59", "08:00:00.000000001", "09:00:00.5")]
    instants[2] = instants[2] if zones[2] else instants[2].replace("09:", "08:")
    rows = [f"{x};{instant}{zone}" for x, instant, zone in zip((5, 4, 7), instants, zones, strict=True)]
    path.write_text("\n".join(["x;logged at", *rows, ""]), encoding="utf-8")
    assert TableReader(path).proposed_time() == TimeSource(column="logged at", unit="ns")
    ((times, values),) = read(path, ("x",), TimeSource(column="logged at"))
    assert np.diff(times) == pytest.approx([1.000000001, 0.499999999], rel=1e-12)
    assert values.tolist() == [5.0, 4.0, 7.0]


def test_a_table_without_a_header_has_numbered_columns_and_its_rising_one_is_the_time(tmp_path: Path) -> None:
    rows = np.array([[5.0, 1.0, 0.1], [4.0, 2.0, 0.2], [6.0, 1.5, 0.3]])
    reader = TableReader(table(tmp_path / "a.csv", rows, names=()))
    assert reader.columns == ("1", "2", "3")
    assert reader.proposed_time().column == "3"


def test_a_column_with_a_unit_that_is_none_of_time_is_not_taken_as_the_time(tmp_path: Path) -> None:
    rows = np.array([[0.0, 1.0], [1.0, 3.0], [2.0, 2.0]])
    path = table(tmp_path / "a.csv", rows, names=("Wheel (deg)", "Slide (mm)"))
    with pytest.raises(MeasurementError, match=r"expected a column of the time.*'Wheel \(deg\)' is in deg"):
        TableReader(path).proposed_time()


def test_signs_of_comment_around_a_name_do_not_count(tmp_path: Path) -> None:
    path = table(tmp_path / "a.tsv", numbers(), ("%Time (s)", "x", "remark 3:10 PM"), "\t")
    ((_, values),) = read(path, ("x",), TimeSource(column="Time (s)"))
    assert len(values) == 300


def test_epoch_times_keep_their_resolution(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x\n" + "".join(f"{1_700_000_000 + i * 0.25},{i}\n" for i in range(8)), encoding="utf-8")
    ((times, _),) = read(path, ("x",), TimeSource(column="t"))
    assert times.tolist() == [i * 0.25 for i in range(8)]


@pytest.mark.parametrize("kind", [pa.timestamp("ns"), pa.int64(), pa.uint64()])
def test_whole_nanoseconds_since_1970_are_exact(kind: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    first_ns = 1_764_380_000_000_000_000
    stamps = pa.array([first_ns + each for each in (1, 50_001, 100_001, 0)]).cast(kind)
    pq.write_table(pa.table({"t_ns": stamps, "x": [0.0, 1.0, 2.0, 3.0]}), path)
    ((times, _),) = read(path, ("x",), TableReader(path).proposed_time())
    assert np.diff(times) == pytest.approx([50e-6, 50e-6, -100.001e-6], rel=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("is empty",)),
        ("a,b\n", ("no line of numbers",)),
        ("a b\n1.5 2.5\n", ("no line of numbers", "comma, semicolon or tab")),
        ("t,x\n0,1\n1,two\n2,3\n", ("column 'x', line 3, value 'two'", "a number", "'.'")),
        ("t,y,x\n0,1,2\n1,2,3\n2,3,1.#QNAN\n", ("column 'x', line 4, value '1.#QNAN'", "a number")),
        ("t,y,x\n03.11.2026 08:00,1,2\n", ("column 't', line 2, value '03.11.2026 08:00'", "a time such as")),
        ("t,x\n2026-11-03T08:00,1\n2026-11-03T08:00Z,2\n", ("column 't', line 3", "a time such as", "zone")),
        ("t,x\n2026-11-03T08:00Z,1\n2026-11-03T08:00,2\n", ("column 't', line 3", "a time such as", "zone")),
        ("t,x\n2026-11-03T08:00 ,1\n2026-11-03T08:01 ,2\n", ("column 't', line 2", "without blanks")),
        ("t,x\n2026-11-03,1\n2026-11-04,2\n", ("no line of numbers", "a time such as")),
        ("t;x\n0;1\n1,5;2.5\n", ("column 'x', line 3, value '2.5'", "decimal sign ','")),
        ("t,x\n0,1\n1,2,3\n2,3\n", ("columns",)),
        ("t,y\n0,1\n1,2\n", ("no column 'x'", "'t', 'y'")),
        ("\x00\x01\x02", ("no text",)),
    ],
)  # fmt: skip
def test_a_bad_table_is_refused_in_one_line(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MeasurementError) as refused:
        read(path, ("x",), TimeSource(column="t"))
    assert "\n" not in str(refused.value)
    assert all(word in str(refused.value) for word in (str(path), *words))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_an_error_names_the_line_of_the_file_whatever_lines_are_empty(end: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    above = ["of a rig,", "", "t,x", "0,1", "", "", "1,2"]
    for wrong, words in (("2,two", "line 8, value 'two'"), ("2", "line 8: Expected 2 columns, got 1: 2")):
        path.write_text(end.join([*above, wrong, "3,4", ""]), encoding="utf-8", newline="")
        with pytest.raises(MeasurementError, match=words):
            read(path, ("x",), TimeSource(column="t", unit="s"))


@pytest.mark.parametrize("cut", ["9.0,1", "9", "\0" * 5000])
def test_a_last_row_that_was_cut_while_written_is_left_out(cut: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x,y\n" + "".join(f"{row},{row},0\n" for row in range(9)) + cut, encoding="utf-8")
    ((times, values),) = read(path, ("x",), TimeSource(column="t", unit="s"))
    assert times.tolist() == values.tolist() == list(range(9))
    path.write_text(f"{path.read_text(encoding='utf-8')}\n9,9,0\n", encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"line 11: Expected 3 columns|is no text"):
        read(path, ("x",), TimeSource(column="t", unit="s"))


def test_a_long_table_is_read_in_bounded_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    line = "".join(f"{i * 0.001:.3f},{i % 977},0.125,0.25\n" for i in range(20_000))
    with path.open("w", encoding="utf-8") as stream:
        stream.write("t,x,y,z\n")
        for _ in range(25):
            stream.write(line)
    tracemalloc.start()
    try:
        count = sum(
            len(block.values) for block in TableReader(path).blocks([Source(column="x")], TimeSource(column="t"))
        )
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert count == 500_000
    assert most < 0.5 * 16 * count  # half of what time and column alone would take


def test_a_file_is_a_table_by_what_it_holds_and_not_by_its_name(tmp_path: Path) -> None:
    text, parquet, bag = tmp_path / "run.dat", tmp_path / "run.bin", tmp_path / "run.csv"
    text.write_text("t,x\n0.0,1.0\n0.1,2.0\n", encoding="utf-8")
    pq.write_table(pa.table({"t": [0.0, 0.1], "x": [1.0, 2.0]}), parquet)
    bag.write_bytes(b"\x89MCAP0\r\n" + bytes(20))
    assert [is_table(path) for path in (text, parquet, bag, tmp_path)] == [True, True, False, False]
    assert TableReader(text).columns == TableReader(parquet).columns == ("t", "x")


def test_more_names_than_cells_are_refused_with_line_and_counts(tmp_path: Path) -> None:
    """Which name is the one too many is not known: each column might bear another's."""
    path = tmp_path / "a.csv"
    path.write_text("exported\nt_s,phi,omega,m\n0,1,2\n1,2,3\n")
    with pytest.raises(MeasurementError, match=r"a\.csv: line 3: 3 cells under 4 names"):
        TableReader(path)
    path.write_text("t_s,phi,omega,,\n0,1,2\n1,2,3\n")  # delimiters at the end of a line name nothing
    assert TableReader(path).columns == ("t_s", "phi", "omega")


@pytest.mark.parametrize("remark", ["%2/8/2018 2:58 PM", "# rig 3"])
def test_a_remark_behind_the_names_is_no_name(remark: str, tmp_path: Path) -> None:
    """A recorder of a real rig writes the date of the run behind the last name, with the sign of a remark."""
    path = tmp_path / "a.tsv"
    path.write_text(f"%Time (s)\tWheel (deg)\t{remark}\n0.0\t10.0\n0.02\t12.0\n", encoding="utf-8")
    assert TableReader(path).columns == ("%Time (s)", "Wheel (deg)")
    ((times, values),) = read(path, ("Wheel (deg)",), TimeSource(column="Time (s)"))
    assert (times.tolist(), values.tolist()) == ([0.0, 0.02], [10.0, 12.0])


@pytest.mark.parametrize(("first", "unit"), [(0.0, "s"), (1.7e9, "s"), (1.7e12, "ms"), (1.7e15, "us"), (1.7e18, "ns")])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_unit_of_stamps_since_1970_is_told_by_their_size(
    first: float, unit: str, suffix: str, tmp_path: Path
) -> None:
    """`rostopic echo -p` writes nanoseconds as `%time`, others milliseconds as `timestamp`, and neither says so."""
    path = tmp_path / f"a{suffix}"
    columns = pa.table({"%time": [int(first) + i * 10**6 for i in range(4)], "x": [1.0, 2.0, 3.0, 4.0]})
    pq.write_table(columns, path) if suffix == ".parquet" else pa_csv.write_csv(columns, path)
    reader = TableReader(path)
    assert reader.proposed_time() == TimeSource(column="%time", unit=unit)
    [(times, _)] = read(path, ("x",), reader.proposed_time())
    assert np.diff(times) == pytest.approx([1e6 * TIME_UNITS[unit]] * 3, abs=3e-7)
