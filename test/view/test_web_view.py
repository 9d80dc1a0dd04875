# SPDX-License-Identifier: Apache-2.0
"""The page as a person sees it: Chromium opens the viewer while samples come, and the picture moves."""

import threading
import time

import numpy as np
import pytest
from browser import Page, Picture, changed_share, colours, region, share_of
from synthetic_four_bar import STRIKER, drawing, events, frame, metrics

from mech_twin.cli.live_view import LIVE_HISTORY
from mech_twin.view.flow import Flow
from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.sending import LIVE
from mech_twin.view.viewer_process import ViewerProcess

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# slower than real time: a browser that draws without a graphics card takes in less than the run gives
PACE = 0.2
SETTLE_S, WATCHED_S = 3.0, 60.0


def fed(scene, stop, pace=PACE, clock=None):
    """Give the scene samples at a steady pace until told to stop; keep the time of the last one."""
    begin, step = time.monotonic(), 0
    while not stop.is_set():
        for due in range(step, int((time.monotonic() - begin) * 1000 * pace)):
            now = frame(due)
            scene.frame(now.motor, now.linkage, now.forces, now.body)
            for event in events(due):
                scene.event(event)
            if scene.drawing_due(now.linkage.time_s):
                scene.drawing(drawing(due))
            if due % 200 == 0:
                scene.metrics(metrics(due))
            step = due + 1
            if clock is not None:
                clock[0] = now.linkage.time_s
        time.sleep(0.02)


def test_what_is_shown_lags_by_a_frame_and_half_a_second_and_seldom_by_two_frames_without_a_graphics_card():
    stop, clock, lags = threading.Event(), [0.0], []
    with (
        ViewerProcess(memory_limit=LIVE_HISTORY, newest_first=True) as viewer,
        RerunScene(
            "four_bar",
            grpc_url=viewer.grpc_url,
            sending=LIVE,
            light=lambda: not viewer.graphics_file.exists(),
            flow=Flow(viewer.reports_directory),
        ) as scene,
    ):
        feeder = threading.Thread(target=fed, args=(scene, stop, 1.0, clock))
        feeder.start()
        try:
            with Page(viewer.web_url, width=1200, height=750, counted=True) as page:
                page.picture_when(lambda seen: share_of(seen, STRIKER) > 0.002, limit_s=180.0)
                page.wait(SETTLE_S)
                page.frames()
                begin = time.monotonic()
                while time.monotonic() - begin < WATCHED_S:
                    page.wait(0.5)
                    seen = page.shown_s()
                    lags.append(clock[0] - seen)
                frame_s = (time.monotonic() - begin) / page.frames()
        finally:
            stop.set()
            feeder.join()
    half = len(lags) // 2
    assert np.median(lags[:half]) <= frame_s + 0.5
    assert np.median(lags[half:]) <= frame_s + 0.5, "the picture falls behind"
    assert np.mean(np.array(lags) <= 2.0 * frame_s + 0.5) >= 0.9


def test_the_page_shows_the_mechanism_and_it_moves(tmp_path):
    stop = threading.Event()
    mechanism = (0.0, 0.06, 0.55, 0.68)
    curves = (0.57, 0.06, 1.0, 0.68)
    with ViewerProcess() as viewer, RerunScene("four_bar", grpc_url=viewer.grpc_url) as scene:
        feeder = threading.Thread(target=fed, args=(scene, stop))
        feeder.start()
        try:
            with Page(viewer.web_url, width=1200, height=750) as page:
                before = page.picture_when(lambda seen: share_of(seen, STRIKER) > 0.002, limit_s=120.0)
                page.wait(2.0)

                def both_moved(seen: Picture) -> bool:  # a linkage comes by where it was before: look on
                    if seen.shape != before.shape:
                        return False
                    moved = changed_share(region(before, *mechanism), region(seen, *mechanism)) > 0.01
                    return moved and changed_share(region(before, *curves), region(seen, *curves)) > 0.005

                after = page.picture_when(both_moved, limit_s=60.0)
        finally:
            stop.set()
            feeder.join()
    assert colours(region(after, *mechanism)) >= 5
