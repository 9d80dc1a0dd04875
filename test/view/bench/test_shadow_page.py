# SPDX-License-Identifier: Apache-2.0
"""A person watches a machine beside its model: a fault is told, acknowledged and shelved, an advice is answered."""

from __future__ import annotations

import json
import re
import subprocess
from contextlib import contextmanager

import numpy as np
import pytest
import yaml
from browser import COMMAND, UP_MS, opened, running
from catalogue import built
from playwright.sync_api import expect

from mech_twin.engine.rollout import roll_out
from mech_twin.files.output_file import plain
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, feed_channels
from mech_twin.studies.monitoring.monitor import MonitorSetup

pytestmark = [pytest.mark.browser, pytest.mark.slow]

NAME, HEALTHY_S, EVERY = "vibration_crank", 160.0, 20
SIGMA = {"linkage.crank.position": 1e-3, "linkage.crank.effort": 2.0}
CHANNELS = [
    {
        "source": {"topic": "joint_states", "joint": "crank", "field": column.rpartition(".")[2]},
        "is": column,
        "sigma": s,
    }
    for column, s in SIGMA.items()
]
WISH = {
    "figure": "torque_peak_nm",
    "wanted": 220.0,
    "output": {"key": "motor/speed_command", "low": 0.5, "high": 1.0, "value": 1.0},
    "step_share": 0.2,
    "cycles": 3,
    "interval_s": 2.0,
    "settling_cycles": 2,
    "trial_cycles": 2,
    "dry_run": True,
}
FAULTY = ("masses.boom_kg=40.0", "masses.extra_kg=9.0")
UNLIKE = ("masses.boom_kg=400.0", "masses.extra_kg=60.0")  # so much that the observer never finds it
RATE_HZ = 50  # as the healthy run was sampled


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return a folder with the map, the reference of a healthy machine, and what is wished."""
    folder = tmp_path_factory.mktemp("shadow")
    run, random = roll_out(built(NAME), HEALTHY_S), np.random.default_rng(1)
    times = run["time_s"][::EVERY]
    shown = {name: run[name][::EVERY] + s * random.standard_normal(len(times)) for name, s in SIGMA.items()}
    ask = catalogue_entry(NAME).capabilities.features
    declared = ask(built(NAME).parameters)
    feed = FeatureFeed(declared, tuple(SIGMA), run_up_s=declared.run_up_s)
    baseline, innovations = fitted_baseline(feed_channels(feed, {name: (times, x) for name, x in shown.items()}))
    setup = MonitorSetup(NAME, baseline, chart_limits(baseline, innovations, 1000.0), (), settling_cycles=1)
    (folder / "healthy.json").write_text(json.dumps(plain(setup)), encoding="utf-8")
    (folder / "map.yaml").write_text(yaml.safe_dump({"machine": NAME, "channels": CHANNELS}), encoding="utf-8")
    (folder / "wish.yaml").write_text(yaml.safe_dump(WISH), encoding="utf-8")
    return folder


@contextmanager
def plant(folder, faulty=FAULTY):
    """Run a machine that is not what the model says."""
    changes = [word for change in (*faulty, f"run.stream_rate_hz={RATE_HZ}") for word in ("--set", change)]
    words = [*COMMAND, "run", NAME, "--namespace", "plant", "--no-record", "--view", "none", *changes]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder)
    try:
        yield
    finally:
        process.terminate()
        process.wait(60)


def test_a_fault_is_acknowledged_and_shelved_and_an_advice_accepted_from_the_page(browser, ros_domain, kept):
    words = ("shadow", NAME, "--from", "plant", "--map", "map.yaml", "--view", "web")
    company = ("--monitor", "healthy.json", "--advise", "wish.yaml")
    with plant(kept), running(*words, *company, folder=kept) as (url, _), opened(browser, url, shows=False) as page:
        expect(page.locator("#state")).to_have_text("locked", timeout=UP_MS)
        expect(page.locator(".plot:has(.u-over)")).to_have_count(4)  # two channels, each with its residual
        expect(page.locator("#command")).to_be_hidden()
        answers, fault = page.locator("#answers li"), page.locator(".fault").first

        # a fault: since when, in the header, and by a button no longer news
        expect(fault).to_have_attribute("data-state", "active", timeout=UP_MS)
        expect(fault).to_contain_text(re.compile(r"active since t = \d+\.\d s"))
        expect(page.locator("#alarm")).to_contain_text("fault: ")
        expect(page.locator("#advice-none")).to_be_visible()  # first somebody looks
        fault.get_by_role("button", name="Acknowledge").click()
        expect(answers.first).to_contain_text("acknowledged", timeout=UP_MS)
        expect(fault).to_contain_text("acknowledged", timeout=UP_MS)
        expect(fault.get_by_role("button", name="Acknowledge")).to_be_disabled()
        fault.get_by_role("button", name="Shelve").click()
        expect(answers.first).to_contain_text("shelved", timeout=UP_MS)
        expect(fault).to_contain_text(re.compile(r"shelved until t = \d+\.\d s"), timeout=UP_MS)
        expect(page.locator("#alarm")).to_be_hidden(timeout=UP_MS)

        # an advice, now that the fault is known
        expect(page.locator("#advice-rows")).to_contain_text("motor/speed_command", timeout=UP_MS)
        expect(page.locator("#advice-rows")).to_contain_text("nothing is sent")
        page.locator("#reject").click()
        expect(answers.first).to_contain_text("rejected", timeout=UP_MS)
        expect(page.locator("#advice-none")).to_be_visible(timeout=UP_MS)
        expect(page.locator("#advice-rows")).to_contain_text("motor/speed_command", timeout=UP_MS)
        page.locator("#accept").click()
        expect(answers.first).to_contain_text(re.compile("accepted|noted|dry run"), timeout=UP_MS)
        page.screenshot(path=str(kept / "shadow.png"))


def test_answers_show_while_the_machine_is_searched_and_an_advice_on_trial_is_rejected(browser, ros_domain, kept):
    trial = WISH | {"dry_run": False, "trial_cycles": 1000, "silence_s": 60.0}
    (kept / "trial.yaml").write_text(yaml.safe_dump(trial), encoding="utf-8")
    words = ("shadow", NAME, "--from", "plant", "--map", "map.yaml", "--view", "web")
    company = ("--monitor", "healthy.json", "--advise", "trial.yaml")
    with (
        plant(kept, UNLIKE),
        running(*words, *company, folder=kept) as (url, process),
        opened(browser, url, shows=False) as page,
    ):
        answers, fault, rows = page.locator("#answers li"), page.locator(".fault").first, page.locator("#advice-rows")
        expect(fault).to_have_attribute("data-state", "active", timeout=UP_MS)
        fault.get_by_role("button", name="Acknowledge").click()
        fault.get_by_role("button", name="Shelve").click()
        expect(answers.first).to_contain_text("shelved", timeout=UP_MS)
        expect(fault).to_contain_text("shelved until")
        expect(rows).to_contain_text("if accepted", timeout=UP_MS)
        expect(page.locator("#state")).to_have_text("searching")
        page.locator("#accept").click()
        expect(answers.first).to_contain_text("on trial", timeout=UP_MS)
        expect(page.locator("#advice-decided")).to_contain_text("accepted: on trial for 1000 cycles")
        expect(rows).to_contain_text("on trial")
        expect(page.locator("#accept")).to_be_disabled()
        page.locator("#reject").click()
        expect(answers.first).to_contain_text("reverted: rejected", timeout=UP_MS)
        expect(rows).not_to_contain_text("on trial")
        expect(page.locator("#advice-decided")).to_have_text(re.compile(r"t = \d+\.\d s: reverted: rejected"))
        process.terminate()
        expect(answers.first).to_have_text("the shadow is over", timeout=UP_MS)
        process.wait(30)


def test_a_hidden_mass_is_identified_from_the_last_seconds_and_the_model_goes_on_with_it(browser, ros_domain, kept):
    words = ("shadow", NAME, "--from", "plant", "--map", "map.yaml", "--view", "web")
    hidden, free = ("masses.extra_kg=9.0",), ("--identify", "masses.extra_kg")
    with (
        plant(kept, hidden),
        running(*words, *free, folder=kept) as (url, _),
        opened(browser, url, shows=False) as page,
    ):
        expect(page.locator("#state")).to_have_text("locked", timeout=UP_MS)
        expect(page.locator("#fit-free")).to_have_text("1 free key: masses.extra_kg")
        answers, told = page.locator("#answers li"), page.locator("#fit-status")
        expect(page.locator("#fit-answers")).to_be_hidden()
        expect(page.locator("#fit-span option").last).to_have_text("10 s", timeout=UP_MS)
        page.locator("#identify").click()
        expect(answers.first).to_have_text("identify: 1 keys, the last 10 s", timeout=UP_MS)
        expect(page.locator("#identify")).to_be_disabled()
        expect(told).to_contain_text(re.compile("which keys the channels see|intervals|held out|start"), timeout=UP_MS)
        expect(told).to_contain_text("found: fitted in", timeout=UP_MS)
        row = page.locator("#fit-rows tr")
        expect(row).to_contain_text("identified")
        low, high = map(float, re.search(r"([\d.]+) to ([\d.]+)", row.inner_text()).groups())
        assert low < 9.0 < high
        with page.expect_download() as saved:
            page.locator("#fit-save").click()
        assert saved.value.suggested_filename == f"{NAME}-identified.yaml"
        text = yaml.safe_load(saved.value.path().read_text(encoding="utf-8"))
        assert low < text["/**"]["ros__parameters"]["masses"]["extra_kg"] < high
        page.screenshot(path=str(kept / "identified.png"))
        page.locator("#take-over").click()
        expect(answers.first).to_contain_text("the model goes on with what was found", timeout=UP_MS)
        expect(told).to_contain_text("taken over")
        expect(page.locator("#take-over")).to_be_disabled()
        expect(page.locator("#state")).to_have_text("locked", timeout=UP_MS)
        page.locator("#identify").click()
        expect(told).not_to_contain_text("taken over", timeout=UP_MS)
        expect(told).to_contain_text(re.compile("found|not better"), timeout=UP_MS)
        before = float(row.locator("td").nth(1).inner_text())
        assert low < before < high, "the model that is fitted anew is the one taken over"
