# SPDX-License-Identifier: Apache-2.0
"""Display names and units, derived from stored names that end in their unit."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches

UNITS = {
    "m": "m", "mm": "mm", "s": "s", "hz": "Hz", "rad": "rad", "deg": "deg", "rpm": "rpm", "n": "N", "kn": "kN",
    "nm": "N m", "ns": "N s", "nms": "N m s", "j": "J", "w": "W", "kw": "kW", "kg": "kg", "rad2": "rad²", "m2": "m²",
    "m3": "m³", "s2": "s²", "pa": "Pa", "mpa": "MPa", "percent": "%", "bar": "bar",
}  # fmt: skip


def caption(name: str) -> tuple[str, str]:
    """Return display name and unit: ``return_speed_m_per_s`` gives (return speed, m/s).

    The unit is empty for a name without a known unit and for a dimensionless number (``share_1``).
    """
    words = name.split("_")
    if "factor_of_" in name or "impacts_above_" in name:  # a ratio of numbers with the same unit; a count
        return " ".join(words), ""
    if words[-1] == "1" and len(words) > 1:
        return " ".join(words[:-1]), ""
    below: list[str] = []
    if "per" in words[1:]:
        place = len(words) - 1 - words[::-1].index("per")
        if all(word in UNITS for word in words[place + 1 :]):
            below, words = words[place + 1 :], words[:place]
    above: list[str] = []
    while len(words) > 1 and words[-1] in UNITS and (not above or above[0] in ("m", "m2", "s", "rad")):
        above.insert(0, words.pop())
    unit = " ".join(UNITS[word] for word in above)
    if below:
        unit = f"{unit or '1'}/{' '.join(UNITS[word] for word in below)}"
    return " ".join(words), unit


def unit_of(name: str) -> str:
    """Return the unit at the end of a stored name, such as N m of ``forces.drive_torque_nm``; empty without one.

    Examples
    --------
    >>> unit_of("forces.drive_torque_nm"), unit_of("rod_force_n.1"), unit_of("impacts_above_1_mm_per_s")
    ('N m', 'N', '')
    >>> unit_of("worst_factor_of_tool.mass_kg")
    ''
    """
    words = name.split(".")
    while len(words) > 1 and words[-1].isdigit():  # index of a component or cart
        words.pop()
    return caption(name if "factor_of_" in name else words[-1])[1]


def titled(name: str) -> str:
    """Return display name with unit: ``drive_torque_nm`` gives "drive torque [N m]"."""
    words, unit = caption(name)
    return f"{words} [{unit}]" if unit else words


def unknown_name(name: object, known: Iterable[str], kind: str = "") -> str:
    """Return the error text for an unknown name: similar known names, or all of them.

    Examples
    --------
    >>> unknown_name("tims", ["time_s", "step"]), unknown_name("x", ["a", "b"], "column ")
    ("no 'tims'; did you mean time_s?", "no column 'x'; there are a, b")
    """
    names = list(known)
    near = get_close_matches(str(name), names, 3)
    return f"no {kind}{name!r}" + (
        f"; did you mean {' or '.join(near)}?" if near else f"; there are {', '.join(names)}"
    )


def axis_title(column: str, unit: str = "") -> str:
    """Return the axis title for a column of a run, without its role; ``unit`` if the name ends in none.

    Examples
    --------
    >>> axis_title("forces.drive_torque_nm"), axis_title("linkage.crank.velocity", "rad/s")
    ('drive torque [N m]', 'crank velocity [rad/s]')
    """
    words = titled(column.partition(".")[2].replace(".", "_") or column)
    return f"{words} [{unit}]" if unit and not words.endswith("]") else words


def metrics_table(metrics: Mapping[str, float]) -> str:
    """Return the metrics as a Markdown table of name, value (four digits) and unit."""
    captioned = [(*caption(name), value) for name, value in metrics.items()]
    rows = [f"| {words} | {value:.4g} | {unit} |" for words, unit, value in captioned]
    return "\n".join(["| quantity | value | unit |", "|:--|--:|:--|", *rows])
