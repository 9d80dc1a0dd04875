# SPDX-License-Identifier: Apache-2.0
"""What a user gets wrong is answered in one line that says what was meant; nothing is computed, nothing written."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest
from command_line import mech_twin
from typer.main import get_command

from mech_twin import api
from mech_twin.cli.main import QUESTIONS, VERBS, app, with_options_repeated
from mech_twin.cli.option_values import seconds
from mech_twin.cli.verb import Excludes
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.errors import key_units, nearest_key
from mech_twin.parameters.load import configuration_file, machine_of_prefix, machine_parameters

SIMULATE = "simulate mb10_breaker --duration 1 "
PRESS = "study compaction_press "
STUDIES = ("sweep", "size", "search", "designs", "synthesise", "regimes")
TIMES = "expected a time such as 3, 3s, 500ms, 2min or 1h"

# what is typed, and what the one line must say
MISTAKES = {
    "duration left out": ("simulate mb10", ["--duration TIME", "2min"]),
    "axis of regimes left out": ("study impact_mass regimes", ["--over KEY=VALUES", "from:to:count"]),
    "part of a name": ("simulate drum --duration 1", ["no machine 'drum'", "did you mean 'winding_drum'"]),
    "misspelt machine": ("analyse mb10_braker", ["did you mean 'mb10_breaker'"]),
    "key without its unit": (
        SIMULATE + "--set body.spring_rate=4e4",
        ["unknown key 'body.spring_rate'", "did you mean 'body.spring_rate_n_per_m' (N/m)"],
    ),
    "misspelt key": (SIMULATE + "--set linkage.rockr_m=1", ["did you mean 'linkage.rocker_m' (m)"]),
    "key of another group": (
        "simulate roller_former --duration 1 --set crank_m=1",
        ["did you mean 'carts.crank_m' (m)"],
    ),
    "misspelt group": ("analyse compaction_press --set linkge.crank_m=1", ["group 'linkge'", "did you mean 'linkage'"]),
    "key of a run": ("run mb10_breaker --set run.duration=3", ["did you mean 'duration_s' (s)"]),
    "key of a file": ("simulate winding_drum --duration 1 --config wrong.yaml", ["line 3", "'package_radius_m' (m)"]),
    "value of a file": (
        "simulate winding_drum --duration 1 --config low.yaml",
        ["'package_radius_m' (line 7), value -1.0", "greater than or equal to 0.000001 m"],
    ),
    "nan": (SIMULATE + "--set motor.rated_power_w=nan", ["motor.rated_power_w", "finite number, in W"]),
    "a word for a number": (SIMULATE + "--set linkage.crank_m=long", ["linkage.crank_m", "'long'", "a number in m"]),
    "no value": (SIMULATE + "--set linkage.crank_m", ["--set linkage.crank_m", "expected key.path=value"]),
    "two settings": (
        SIMULATE + "--set body.spring_rate_n_per_m=4e4 linkage.crank=1",
        ["linkage.crank", "did you mean 'linkage.crank_m' (m)"],
    ),
    "crank too long": (
        "analyse compaction_press --set linkage.crank_m=5.0",
        ["cannot make a full turn", "try crank <= 0.23 m"],
    ),
    "coupler too short": (
        "analyse compaction_press --set linkage.coupler_m=0.1",
        ["cannot make a full turn", "try coupler 0.34 to 0.75 m"],
    ),
    "rod too short": ("analyse vibration_crank --set crank_m=5.0", ["cannot make a full turn", "try rod_m >= 5.3"]),
    "no number of seconds": ("simulate mb10_breaker --duration soon", ["--duration", "soon", TIMES]),
    "duration nan": ("simulate mb10_breaker --duration nan", ["--duration", "nan", TIMES]),
    "negative time": ("replay bag --start -3", ["--start", "-3", TIMES]),
    "no duration": ("simulate mb10_breaker", ["--duration"]),
    "no angle": ("analyse mb10_breaker --crank-deg abc", ["--crank-deg abc", "expected a valid number"]),
    "bounds in the wrong order": (
        PRESS + "search --bound crank=0.5:0.1",
        ["--bound crank=0.5:0.1", "expected NAME=LOW:HIGH, LOW not above HIGH"],
    ),
    "unknown variable": (PRESS + "search --bound crnk=0.1:0.2", ["no variable 'crnk'", "crank_m"]),
    "limit of zero": (PRESS + "size --limit non_uniformity=0", ["non_uniformity=0", "above 0"]),
    "negative limit": (PRESS + "size --limit non_uniformity=-1", ["non_uniformity=-1", "above 0"]),
    "limit of a mass": (
        "study vibration_crank size --limit counterweight_mass_kg=0",
        ["counterweight_mass_kg=0", "above 0"],
    ),
    "unknown limit": (PRESS + "size --limit non_unifrmity=0.1", ["no limit 'non_unifrmity'", "non_uniformity"]),
    "unknown objective": (PRESS + "search --objective mass", ["no objective 'mass'", "peak_torque_nm"]),
    "swept key": (PRESS + "sweep --over linkage.crank=1:2:3", ["did you mean 'linkage.crank_m' (m)"]),
    "key of regimes": ("study impact_mass regimes --over impact.restitution=0:1:9", ["did you mean 'restitution'"]),
    "no answer": ("study winding_drum size", ["nothing to size", "there is an answer for mb10_breaker"]),
    "question first": ("study size winding_drum", ["nothing to size"]),
    "no question": ("study impact_mass", ["name a question", "sweep", "synthesise", "regimes"]),
    "misspelt question": ("study mb10_breaker swep", ["no question 'swep'", "did you mean 'sweep'"]),
    "misspelt command": ("simulat mb10_breaker", ["no command 'simulat'", "did you mean 'simulate'"]),
    "misspelt option": (
        "run mb10_breaker --recrod bag",
        ["no option '--recrod' of mech-twin run", "did you mean '--record PATH'"],
    ),
    "beginning of an option": ("simulate mb10 --dur 3", ["no option '--dur'", "did you mean '--duration TIME'"]),
    "option of no verb": ("simulate mb10 -d 3", ["no option '-d'", "`mech-twin simulate --help` lists them"]),
    "option before the verb": ("--set a=1", ["no option '--set' of mech-twin", "`mech-twin --help`"]),
    "misspelt option of a question": (
        PRESS + "size --limt a=1",
        ["'--limt' of mech-twin study MACHINE size", "--limit"],
    ),
    "machine left out": ("simulate", ["missing MACHINE", "expected machine"]),
    "second side left out": ("compare mb10", ["missing B", "what to compare it with"]),
    "map of nothing": ("map", ["missing MEASUREMENT", "runs of one kind: bags, or tables"]),
    "one machine too many": ("simulate mb10 drum --duration 1", ["'drum'", "mech-twin simulate MACHINE [OPTIONS]"]),
    "export of nothing": ("export", ["export: expected a command after it: fmu"]),
    "study of nothing": ("study", ["study: expected a machine and a question", "sweep|size"]),
    "question without a machine": ("study size", ["study size", "expected a machine", "study MACHINE size"]),
    "value left out": ("run mb10 --view-port", ["missing value of --view-port", "port of the web view"]),
    "value of a switch": ("run mb10 --hold=3", ["--hold takes no value"]),
    "option for a value": (
        "run mb10 --record --no-record",
        ["--record --no-record", "recording directory", "an option"],
    ),
    "option for a setting": ("analyse mb10 --set --json", ["--set --json", "expected KEY=VALUE", "an option"]),
    "recording and none": ("run mb10 --no-record --record x", ["--record and --no-record exclude each other"]),
    "port without a page": ("run mb10 --view none --view-port 9000", ["--view-port 9000", "--view web beside it"]),
    "port of no page": ("shadow mb10 --from x --view-port 9000", ["--view-port 9000", "--view web beside it"]),
    "samples in a table": ("simulate mb10 --duration 1 --samples", ["--samples goes with --json", "--table FILE"]),
    "seed of nothing": (SIMULATE + "--seed 3", ["--seed goes with --sensors"]),
    "all as CSV": (SIMULATE + "--csv --all", ["--csv and --all exclude each other"]),
    "rate of a recomputation": ("replay bag --analyse --rate 2", ["--analyse and --rate exclude each other"]),
    "result of a replay": ("replay bag --json", ["--json goes with --analyse or --resimulate"]),
    "page of a file": ("view bag --save x.rrd --port 9000", ["--save and --port exclude each other"]),
    "configuration of a view": ("view bag --config x.yaml", ["--config goes with --map"]),
    "quality as CSV": ("info bag --map m.yaml --csv", ["--map and --csv exclude each other"]),
    "width of a quality": ("info bag --map m.yaml --wide", ["--map and --wide exclude each other"]),
    "length of a run": ("identify mb10 bag --duration 3", ["--duration goes with --plan"]),
    "plan of a fit": ("identify mb10 --plan --hold-out 0.2", ["--plan and --hold-out exclude each other"]),
    "design with a baseline": ("monitor mb10 --design --baseline x", ["--design and --baseline exclude each other"]),
    "known thresholds": ("monitor mb10 bag --baseline x.json --seed 8", ["--seed 8", "holds thresholds already"]),
    "front of one objective": (PRESS + "search --points 5", ["--points 5", "expected several --objective"]),
    "two ways to spread": (
        PRESS + "designs --cores 2 --scheduler tcp://127.0.0.1:1",
        ["--cores and --scheduler exclude each other"],
    ),
    "map of no kind": ("map run.csv mb10 --out x.txt", ["x.txt", ".yaml or .yml"]),
    "change of a fixed key": (SIMULATE + "--change linkage.crank_m=1@0.5", ["--change", "expected a live key"]),
    "change of no key": (
        SIMULATE + "--change body.spring=3@0.5",
        ["--change body.spring=3@0.5", "unknown key 'body.spring'", "did you mean 'body.spring_rate_n_per_m' (N/m)"],
    ),
    "sweep of the impossible": (
        PRESS + "sweep --over linkage.crank_m=5:6:3 --no-picture",
        ["no point of the sweep is possible (3 refused)", "cannot make a full turn"],
    ),
    "table of no kind": (PRESS + "sweep --over linkage.crank_m=0.05,0.06 --out t.xlsx", ["t.xlsx", ".parquet or .csv"]),
    "configuration of no kind": (PRESS + "search --out found.txt", ["found.txt", ".yaml or .yml"]),
    "picture of no kind": ("study impact_mass regimes --over restitution=0:1:9 --out map.doc", ["map.doc", ".png"]),
    "designs of no kind": (PRESS + "designs --out designs.csv", ["designs.csv", ".parquet"]),
    "nothing to hold": ("run mb10_breaker --hold --view none", ["--hold", "expected --view web"]),
    "no such bag": ("info nothing", ["nothing: there is no such bag"]),
    "no such file": (SIMULATE + "--config none.yaml", ["none.yaml", "No such file"]),
    "second unknown key": ("analyse winding_drum --set a=1 b=2", ["unknown key 'a' (value 1)", "unknown key 'b'"]),
    "infinite length": (SIMULATE + "--set linkage.crank_m=inf", ["linkage.crank_m", "finite number, in m"]),
    "negative length": (SIMULATE + "--set linkage.crank_m=-0.1", ["value -0.1", "greater than or equal to", " m"]),
    "several numbers for one": (SIMULATE + "--set linkage.crank_m=[1,2]", ["value [1, 2]", "number, in m"]),
    "a number for a group": (SIMULATE + "--set linkage=4", ["key 'linkage', value 4", "expected a group of keys"]),
    "setting without a key": (SIMULATE + "--set =4", ["--set =4", "expected key.path=value"]),
    "unknown unit of time": ("simulate mb10_breaker --duration 3sec", ["--duration 3sec", TIMES]),
    "comma for a point": ("simulate mb10_breaker --duration 1,5", ["--duration 1,5", TIMES]),
    "endless duration": ("simulate mb10_breaker --duration inf", ["--duration inf", TIMES]),
    "samples of no kind": (SIMULATE + "--table t.xls", ["t.xls", ".parquet or .csv or .tsv"]),
    "bag in no place": (SIMULATE + "--bag /proc/x", ["/proc/x", "cannot be written"]),
    "bag over a file": (SIMULATE + "--bag low.yaml", ["low.yaml"]),
    "bag in a file": (SIMULATE + "--bag low.yaml/bag", ["low.yaml"]),
    "damaged bag": ("replay damaged", ["damaged"]),
    "table in no place": (SIMULATE + "--table /proc/x.csv", ["/proc/x.csv", "cannot be written"]),
    "sensors of nothing": (SIMULATE + "--sensors s.yaml", ["--sensors goes with --bag or --table"]),
    "negative seed": (SIMULATE + "--seed -1", ["--seed", "greater than or equal to 0"]),
    "half a seed": (SIMULATE + "--seed 1.5", ["--seed 1.5", "expected a valid integer"]),
    "change without its time": (
        SIMULATE + "--change body.spring_rate_n_per_m=1e4",
        ["--change body.spring_rate_n_per_m=1e4", "expected KEY=VALUE@SECONDS"],
    ),
    "change out of bounds": (
        SIMULATE + "--change body.spring_rate_n_per_m=-1@0.5",
        ["value -1", "greater than or equal to 1 N/m"],
    ),
    "file of another machine": (
        "simulate mb10_breaker --duration 1 --config low.yaml",
        ["low.yaml", "value 'winding_drum'", "expected 'mb10_breaker'"],
    ),
    "folder for a file": (SIMULATE + "--config .", ["cannot be read", "Is a directory"]),
    "one position of a cycle": ("analyse mb10_breaker --cycle 1", ["--cycle", "greater than or equal to 2"]),
    "position and cycle": ("analyse mb10_breaker --cycle 8 --crank-deg 5", ["--crank-deg and --cycle exclude"]),
    "angle nan": ("analyse mb10_breaker --crank-deg nan", ["--crank-deg nan", "finite angle in degrees"]),
    "unknown pace": ("run mb10_breaker --pace fast", ["--pace fast", "expected 'realtime' or 'max'"]),
    "unknown view": (
        "run mb10_breaker --view nothing",
        ["--view nothing", "web, none or a file NAME.rrd"],
    ),
    "port too high": ("run mb10_breaker --view-port 99999", ["--view-port", "less than or equal to 65535"]),
    "namespace of no kind": ("run mb10_breaker --namespace 1bad", ["--namespace 1bad", "letters, digits and _"]),
    "recording in no place": ("run mb10_breaker --record /proc/bag", ["/proc/bag", "cannot be written"]),
    "rate of zero": ("replay bag --rate 0", ["--rate 0", "expected 0.001 to 1000"]),
    "two ways to recompute": ("replay bag --analyse --resimulate", ["--analyse and --resimulate exclude each other"]),
    "tolerance of a replay": ("replay bag --tolerance 0.1", ["--tolerance goes with --analyse"]),
    "map of a replay": ("replay bag --map map.yaml", ["--map goes with --analyse"]),
    "two machines compared": ("compare impact_mass winding_drum --duration 0.01", ["expected one machine"]),
    "nothing to compare": (
        "compare impact_mass impct_mass",
        ["impct_mass: there is no such recording", "did you mean 'impact_mass'"],
    ),
    "negative tolerance": ("compare mb10 mb10 --tolerance -1", ["--tolerance", "greater than or equal to 0"]),
    "a motor of one's own": (
        "simulate winding_drum --duration 0.01 --set run.motor=a:B",
        ["key 'run.motor', value 'a:B'", "`mech-twin run` takes it"],
    ),
    "comparison of no kind": ("compare mb10 mb10 --picture x.doc", ["x.doc", ".png or .svg"]),
    "view of no kind": ("view bag --save x.png", ["x.png", "ends in .rrd"]),
    "nothing to recover": ("recover nothing out", ["nothing: there is no such bag"]),
    "nobody to shadow": ("shadow mb10", ["missing option --from NAMESPACE"]),
    "time of a shadow": ("shadow mb10 --from x --duration soon", ["--duration soon", TIMES]),
    "uncertain without its unit": (
        "shadow mb10 --from x --uncertain linkage.crank=2%",
        ["--uncertain linkage.crank=2%", "did you mean 'linkage.crank_m' (m)"],
    ),
    "faults without a reference": ("shadow mb10 --from x --black-box d", ["--black-box goes with --monitor"]),
    "no run to identify": ("identify mb10", ["expected at least one run"]),
    "plan without its sensors": ("identify mb10 --plan", ["--plan goes with --sensors"]),
    "unknown motion": ("identify mb10 bag --motion fast", ["--motion fast", "'auto', 'measured', 'simulated'"]),
    "time of a beginning": ("identify mb10 bag --latest-begin later", ["--latest-begin later", TIMES]),
    "no run to monitor": ("monitor mb10", ["expected at least one run"]),
    "time to skip": ("monitor mb10 bag --skip later", ["--skip later", TIMES]),
    "no such place": ("reproduce --figures /proc/figures", ["/proc/figures", "cannot be written"]),
}


def write_files(folder: Path) -> None:
    """Write two configurations that are wrong, and a recording that is damaged."""
    (folder / "damaged").mkdir()
    (folder / "damaged" / "damaged_0.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x00" * 100)
    text = configuration_file("winding_drum").read_text(encoding="utf-8")
    lines = text.splitlines()
    place = next(i for i, line in enumerate(lines) if line.strip().startswith("package_radius_m:"))
    start = next(i for i, line in enumerate(lines) if line.strip().startswith("ros__parameters:"))
    wrong = [*lines[: start + 1], "    package_radios_m: 0.1", *lines[start + 1 :]]
    (folder / "wrong.yaml").write_text("\n".join(wrong[start - 1 :]), encoding="utf-8")
    low = [*lines[start - 1 : start + 1], *["    # more"] * 4, "    package_radius_m: -1.0", *lines[start + 1 : place]]
    (folder / "low.yaml").write_text("\n".join([*low, *lines[place + 1 :]]), encoding="utf-8")


@pytest.mark.parametrize("kind", MISTAKES)
def test_a_mistake_is_answered_in_one_line_that_helps(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed, expected = MISTAKES[kind]
    write_files(tmp_path)
    before = set(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    said = mech_twin(*typed.split())
    assert said.code == 2
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1, said.err
    for words in expected:
        assert words in said.err
    assert set(tmp_path.iterdir()) == before


def _verbs() -> dict[str, Any]:
    """Return every verb, and every question of ``study``, with its command."""
    commands = dict(get_command(app).commands)
    return {**commands, **commands.pop("study").commands}


@pytest.mark.parametrize(
    "name", [name for name, verb in _verbs().items() if {"as_json", "as_csv"} <= {p.name for p in verb.params}]
)
def test_a_result_has_one_form(name: str) -> None:
    needed = [word for each in _verbs()[name].params if each.required for word in _typed(each)]
    words = ["study", "mb10", name] if name in STUDIES else [name]
    said = mech_twin(*words, *needed, "--json", "--csv")
    assert said.code == 2
    assert said.err == "mech-twin: --json and --csv exclude each other: one form of output\n"


def _typed(parameter: Any) -> list[str]:
    values = {"machine": "mb10", "over": "a=1,2", "duration_s": "1"}
    value = values.get(parameter.name, "x")
    return [value] if parameter.param_type_name == "argument" else [parameter.opts[0], value]


def test_every_rule_names_options_that_its_verb_has() -> None:
    for name, verb in {**VERBS, **QUESTIONS}.items():
        known = {parameter.name for parameter in _verbs()[name].params}
        for rule in verb.rules:
            named = (rule.first, rule.second) if isinstance(rule, Excludes) else (rule.option, *rule.others)
            assert set(named) <= known, (name, rule)


@pytest.mark.parametrize("name", _verbs())
def test_no_option_is_taken_for_the_value_of_another(name: str) -> None:
    words = ["study", "mb10", name] if name in STUDIES else [name]
    for parameter in _verbs()[name].params:
        if parameter.param_type_name != "option" or parameter.is_flag:
            continue
        option = parameter.opts[0]
        said = mech_twin(*words, option, "--help")
        assert said.code == 2
        assert said.err.startswith(f"mech-twin: {option} --help: expected "), said
        assert said.err.endswith("found an option\n")


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_beginning_that_one_machine_has_names_it(name: str) -> None:
    others = [other for other in CATALOGUE if other != name]
    least = next(i for i in range(1, len(name) + 1) if not any(other.startswith(name[:i]) for other in others))
    assert machine_of_prefix(name[:least]) == name
    assert machine_of_prefix(name) == name


def test_no_beginning_names_no_machine() -> None:
    with pytest.raises(ConfigurationError, match="no machine ''"):
        machine_of_prefix("")


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_key_is_found_again_by_a_beginning_that_no_other_has(name: str) -> None:
    units = key_units(type(machine_parameters(name)))
    for key in units:
        for end in range(key.rfind(".") + 2, len(key) + 1):
            if [other for other in units if other.startswith(key[:end])] == [key]:
                assert nearest_key(key[:end], units) == key


@pytest.mark.parametrize(
    ("machine", "wrong", "right"),
    [
        ("compaction_press", {"linkage.crank_m": 5.0}, {"linkage.crank_m": 0.23}),
        ("compaction_press", {"linkage.coupler_m": 0.1}, {"linkage.coupler_m": 0.34}),
        ("mb10_breaker", {"linkage.crank_m": 1.0}, {"linkage.crank_m": 0.076}),
    ],
)
def test_the_length_that_is_proposed_lets_the_crank_turn(machine, wrong, right) -> None:
    with pytest.raises(ConfigurationError, match=rf"try (crank <=|coupler) {next(iter(right.values()))}"):
        machine_parameters(machine, None, wrong)
    try:
        machine_parameters(machine, None, right)
    except ConfigurationError as refused:  # the linkage turns; what stands around it has conditions of its own
        assert "full turn" not in str(refused)
        assert "transmission" not in str(refused)


@pytest.mark.parametrize(
    ("typed", "meant"), [("3", 3.0), ("3s", 3.0), ("500ms", 0.5), ("2min", 120.0), ("1h", 3600.0), ("1e-3", 1e-3)]
)
def test_a_time_may_have_its_unit(typed: str, meant: float) -> None:
    assert seconds(typed) == pytest.approx(meant, rel=1e-15)


def test_several_assignments_may_follow_one_option() -> None:
    typed = "analyse --set a=1 b=2 press --limit x=1 y=-2 --json"
    meant = "analyse --set a=1 --set b=2 press --limit x=1 --limit y=-2 --json"
    assert with_options_repeated(typed.split()) == meant.split()


@pytest.mark.parametrize("name", ["simulate", "identify", "sweep", "size", "search"])
def test_a_function_of_python_has_the_defaults_of_its_verb(name: str) -> None:
    declared = {**VERBS, **QUESTIONS}[name].model_fields
    taken = inspect.signature(getattr(api, name)).parameters
    shared = declared.keys() & taken.keys() - {"settings", "free", "runs", "priors"}  # mappings there
    assert len(shared) >= 3
    for each in shared - {"points"}:  # without a front none may be given
        absent = taken[each].default is inspect.Parameter.empty
        assert declared[each].is_required() if absent else declared[each].default == taken[each].default, each
