"""A story: the add-on is disabled and enabled twenty times while a 3D view is in Rendered shading."""

import faulthandler
import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from stage import PACKAGE, Report, run_story, view_area

TIMES = 20
MOST_S, HUNG_S = 8, 90


def story(report):
    bpy.ops.livehand.add_hand()
    bpy.ops.livehand.set_engine()
    longest = 0.0
    for number in range(TIMES):
        faulthandler.dump_traceback_later(HUNG_S, exit=True)
        view_area().spaces.active.shading.type = "RENDERED"
        # Sometimes before the avatar is loaded, sometimes while an image is rendered, sometimes afterwards.
        yield 0.2 * (number % 7)
        start = time.perf_counter()
        bpy.ops.preferences.addon_disable(module=PACKAGE)
        longest = max(longest, time.perf_counter() - start)
        yield 0.1
        bpy.ops.preferences.addon_enable(module=PACKAGE)
        bpy.context.scene.render.engine = "LIVEHAND"
        report.figures["toggled"] = number + 1
        report.write()
    faulthandler.cancel_dump_traceback_later()
    report.figures["longest_disabling_s"] = round(longest, 2)
    report.check(longest < MOST_S, "disabling takes too long")


the_report = Report()
run_story(story(the_report), the_report)
