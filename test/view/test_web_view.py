# SPDX-License-Identifier: Apache-2.0
"""The page as a person sees it: Chromium opens the viewer while samples come, and the picture moves."""

import threading
import time

import pytest
from browser import Page, Picture, changed_share, colours, region, share_of
from synthetic_four_bar import STRIKER, drawing, events, frame, metrics

from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.sending import LIVE
from mech_twin.view.viewer_process import ViewerProcess

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# slower than real time: a browser that draws without a graphics card takes in less than the run gives
PACE = 0.2


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


def test_what_is_shown_keeps_up_with_the_run_in_a_browser_without_a_graphics_card():
    stop, clock = threading.Event(), [0.0]
    with (
        ViewerProcess(memory_limit="32MiB", newest_first=True) as viewer,
        RerunScene("four_bar", grpc_url=viewer.grpc_url, sending=LIVE, light=lambda: True) as scene,
    ):
        feeder = threading.Thread(target=fed, args=(scene, stop, 1.0, clock))
        feeder.start()
        try:
            with Page(viewer.web_url, width=1200, height=750) as page:
                page.picture_when(lambda seen: share_of(seen, STRIKER) > 0.002, limit_s=180.0)
                shown, run = page.shown_s(), clock[0]
                page.wait(60.0)
                gained, passed = page.shown_s() - shown, clock[0] - run
        finally:
            stop.set()
            feeder.join()
    assert passed > 10.0
    assert gained > 0.7 * passed, "the picture falls behind for good"


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
