"""Cycles in the benchmark: which stages are timed, and when Cycles is left out."""

from argparse import Namespace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.shot import HandPose
from livehand.backend.research.benchmark.motion import MotionFrame
from livehand.livehand_blender.capture.scene import capture_scene
from livehand.livehand_blender.research import command
from livehand.livehand_blender.research.cycles import CyclesHand

K = np.array([[40.0, 0, 16], [0, 40, 12], [0, 0, 1]])
FRAME = MotionFrame(
    HandPose.rest(), Camera(K, look_at(np.array([0, -1.0, 0]), np.zeros(3), np.array([0, 0, 1.0])), (32, 24))
)


def test_a_cycles_frame_is_synchronised_then_rendered():
    posed = []
    hand = CyclesHand(capture_scene(1), SimpleNamespace(set_pose=posed.append))
    before = list(bpy.app.handlers.render_stats)
    stages = hand.render(FRAME, 2)
    assert list(stages) == ["sync", "render"]
    assert min(cost.wall_ms for cost in stages.values()) > 0
    assert posed == [FRAME.pose]
    assert (hand.scene.cycles.samples, hand.scene.cycles.use_denoising) == (2, True)
    assert (hand.scene.render.resolution_x, hand.scene.render.resolution_y) == (32, 24)
    assert list(bpy.app.handlers.render_stats) == before


@pytest.mark.parametrize(
    ("missing", "no_cycles", "has_cycles"), [((), False, True), (("skimage",), False, False), ((), True, False)]
)
def test_cycles_runs_where_it_is_installed_and_wanted(monkeypatch, capsys, missing, no_cycles, has_cycles):
    given = []
    monkeypatch.setattr(command.benchmark, "run", lambda args, make_cycles: given.append(make_cycles) or {})
    monkeypatch.setattr(command, "find_spec", lambda name: None if name in missing else object())
    command.run(Namespace(no_cycles=no_cycles))
    assert (given[0] is not None) == has_cycles
    assert ("skimage not installed" in capsys.readouterr().out) == bool(missing)
