# SPDX-License-Identifier: Apache-2.0
"""A configuration is refused in one line that names file, key, value and what was expected."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree, tree_from_flat
from mech_twin.declarations.quantity import lower, upper
from mech_twin.parameters import load
from mech_twin.parameters.load import assignments, configuration_file, file_tree, machine_parameters, text_tree

DRUM = "winding_drum"


def refused(name: str, overrides: dict[str, object]) -> str:
    with pytest.raises(ConfigurationError) as caught:
        machine_parameters(name, overrides=overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_wrong_type_names_key_and_value() -> None:
    text = refused(DRUM, {"package_radius_m": "wide"})
    assert "package_radius_m" in text and "'wide'" in text and "number" in text


def test_a_value_out_of_range_names_key_value_and_bound() -> None:
    text = refused(DRUM, {"package_radius_m": -0.3})
    assert "package_radius_m" in text and "-0.3" in text and "greater than" in text


@pytest.mark.parametrize(
    ("name", "key", "value", "scale"),
    [
        ("mb10_breaker", "body.friction.coulomb_nm", 1e8, "body.inertia_kg_m2"),
        ("mb10_breaker", "friction.viscous_nms_per_rad", 1e4, "linkage.crank_inertia_kg_m2"),
        ("compaction_press", "coupling.step_s", 0.2, "drive.speed_rpm"),
        ("compaction_press", "links.plate.inertia_kg_m2", 1e4, "links.plate.mass_kg"),
        ("compaction_press", "links.pendulum.centroid_across_m", 100.0, "linkage.pendulum_m"),
    ],
)
def test_a_bound_as_printed_is_allowed(name: str, key: str, value: float, scale: str) -> None:
    configured: Any = machine_parameters(name)
    for part in scale.split("."):
        configured = getattr(configured, part)
    for number in range(8):
        overrides = {scale: configured * (1.0 + 0.00137 * number)}
        found = re.search(r"at most ([\d.e+-]+)", refused(name, {**overrides, key: value}))
        assert found is not None
        machine_parameters(name, None, {**overrides, key: float(found[1])})


@pytest.mark.parametrize("digits", [3, 6])
@given(value=st.floats(1e-9, 1e9), sign=st.sampled_from([1.0, -1.0]))
def test_a_printed_bound_is_next_to_the_bound_and_on_its_own_side(digits: int, value: float, sign: float) -> None:
    bound, unit = sign * value, 10.0 ** (1 - digits) * value
    assert bound - 2.0 * unit < float(upper(bound, digits)) <= bound
    assert bound <= float(lower(bound, digits)) < bound + 2.0 * unit


@pytest.mark.parametrize("number", ["0x" + "f" * 5000, "0b" + "1" * 20_000, "9" * 400, "9" * 5000, "1:" * 400 + "1"])
def test_a_whole_number_that_no_float_holds_is_refused_in_a_short_line(number: str, tmp_path: Path) -> None:
    """Those in other notations can be read, and cannot be told in decimals."""
    file = tmp_path / "drum.yaml"
    text = configuration_file(DRUM).read_text(encoding="utf-8")
    file.write_text(re.sub(r"package_radius_m: \S+", f"package_radius_m: {number}", text), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=str(file)) as caught:
        machine_parameters(DRUM, file)
    assert len(str(caught.value)) < 1000
    with pytest.raises(ConfigurationError, match="package_radius_m") as caught:
        machine_parameters(DRUM, None, assignments([f"package_radius_m={number}"]))
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("number", ["1:" * 400 + "1.5", "1:" * 100_000 + "1.5", "1e400"])
def test_a_number_that_is_too_large_is_not_finite_and_refused(number: str) -> None:
    with pytest.raises(ConfigurationError, match=r"package_radius_m.*finite"):
        machine_parameters(DRUM, None, assignments([f"package_radius_m={number}"]))


def test_what_is_refused_is_shown_shortened_and_not_all_of_it(tmp_path: Path) -> None:
    text = refused(DRUM, {"package_radius_m": "x" * 10_000} | {f"unknown_{i}": i for i in range(100)})
    assert len(text) < 5000
    assert "and 81 more" in text


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    text = configuration_file(DRUM).read_text(encoding="utf-8")
    file = tmp_path / "drum.yaml"
    file.write_text("\n".join(line for line in text.splitlines() if "package_radius_m" not in line), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=rf"{file}.*package_radius_m.*missing"):
        machine_parameters(DRUM, file)


def test_an_unknown_machine_is_named_with_a_near_one() -> None:
    with pytest.raises(ConfigurationError, match=r"winding_drun.*did you mean 'winding_drum'"):
        machine_parameters("winding_drun")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "ros__parameters"),
        ("[1, 2]", "ros__parameters"),
        ("/**: {ros__parameters: 3}", "ros__parameters"),
        ("/**: {ros__parameters: {a: 1, a: 2}}", "twice"),
        ("/**: {ros__parameters: {a: &x 1, b: *x}}", "alias"),
        ("/**: {ros__parameters: {1: 2}}", "not a word"),
        ("a: [", "not a valid YAML file"),
        ("/**: " + "[" * 100, "nested deeper"),
        ("!!python/object/apply:os.system ['true']", "not a valid YAML file"),
    ],
)
def test_a_file_that_is_no_parameter_file_is_refused(text: str, expected: str) -> None:
    with pytest.raises(ConfigurationError, match="given") as caught:
        text_tree(text, "given")
    assert expected in str(caught.value)


def test_a_file_that_is_not_there_or_no_text_or_too_large_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file"):
        file_tree(tmp_path / "none.yaml")
    (tmp_path / "raw.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="UTF-8"):
        file_tree(tmp_path / "raw.yaml")
    (tmp_path / "large.yaml").write_bytes(b"#" * 2_000_000)
    with pytest.raises(ConfigurationError, match="larger"):
        file_tree(tmp_path / "large.yaml")


def test_the_more_specific_section_of_a_file_wins() -> None:
    text = "/m/linkage: {ros__parameters: {a: 1.0}}\n/**: {ros__parameters: {a: 2.0, b: 3.0}}"
    assert text_tree(text, "given") == {"a": 1.0, "b": 3.0}


@pytest.mark.parametrize("text", ["novalue", "=3", "a=[1", "a: b=: c: d"])
def test_an_assignment_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="--set"):
        tree_from_flat(assignments([text, "a.b=1", "a=2"] if text == "a: b=: c: d" else [text]))


def test_a_key_that_is_assigned_twice_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"--set a=2: expected key\.path=value, each key once"):
        assignments(["a=1", "b=1", "a=2"])


trees = st.recursive(
    st.floats(allow_nan=False), lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3), max_leaves=8
).filter(lambda tree: isinstance(tree, dict))


@given(trees)
def test_laying_a_tree_over_itself_changes_nothing(tree: dict[str, object]) -> None:
    assert merged_tree(tree, tree) == tree
    assert merged_tree({}, tree) == tree


@pytest.mark.slow
@settings(max_examples=1000, deadline=None, derandomize=True)
@given(st.data())
def test_a_mutated_configuration_is_accepted_or_refused_in_one_line(data: st.DataObject) -> None:
    text = bytearray(configuration_file(DRUM).read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    try:
        text_tree(bytes(text).decode("utf-8", "replace"), "mutated")
    except ConfigurationError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 1e-3), ("1e5", 1e5), ("-2E+4", -2e4), ("inf", math.inf), ("-inf", -math.inf), (".5e1", 5.0)],
)
def test_a_number_in_scientific_form_is_a_number(text: str, value: float) -> None:
    """YAML 1.1 reads 1e-3 (no point) and inf as words; ROS 2 parameter files and people mean numbers."""
    assert assignments([f"a.b={text}"]) == {"a.b": value}
    assert text_tree(f"/**:\n  ros__parameters:\n    a: {text}\n", "file")["a"] == value


def test_words_stay_words() -> None:
    """Words that merely begin like a number form are not converted."""
    assert assignments(["a=infinite", "b=ideal", "c=nano", "d=e5"]) == {
        "a": "infinite",
        "b": "ideal",
        "c": "nano",
        "d": "e5",
    }


def test_an_infinite_value_is_refused_by_its_key() -> None:
    """Infinity is read as a number, and refused as one where a finite number is declared."""
    with pytest.raises(ConfigurationError, match=r"stop_position_m.*inf"):
        machine_parameters("impact_mass", overrides=assignments(["stop_position_m=inf"]))


def test_a_text_that_is_no_yaml_is_refused_with_its_place_in_the_file_alone(tmp_path) -> None:
    file = tmp_path / "open.yaml"
    file.write_text("/**:\n  ros__parameters:\n    a: [1\n", encoding="utf-8")
    where = r"open\.yaml: not a valid YAML file: .* at line 3, column 8"
    with pytest.raises(ConfigurationError, match=where) as caught:
        file_tree(file)
    assert "unicode string" not in str(caught.value)


def test_a_batch_reads_its_configuration_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read = []
    scan = yaml.parse
    monkeypatch.setattr(yaml, "parse", lambda text, **how: read.append(text) or scan(text, **how))
    load._parsed.cache_clear()
    for radius_m in (0.1, 0.2, 0.3):
        assert machine_parameters(DRUM, overrides={"package_radius_m": radius_m}).package_radius_m == radius_m
    assert len(read) == 1


def test_what_one_does_to_a_configuration_it_has_read_the_next_does_not_see() -> None:
    file = configuration_file(DRUM)
    known = file_tree(file)
    known["supply"].clear()
    assert file_tree(file)["supply"]
