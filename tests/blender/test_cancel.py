"""Esc during a render at 4K: the user is asked all the time, progress moves, and the render ends soon."""

import time
from functools import partial

import bpy
import pytest
from livehand.backend.render.background import BackgroundWork
from livehand.livehand_blender.render.engine import LiveHandRender
from livehand.livehand_blender.rig.hand import find_hands

SIZE_PX = (3840, 2160)
CANCELLED_S = 0.5
# Of the engine's own thread, between two questions: whatever else this machine does takes none of it.
BUSY_S = 0.2


class Questions:
    """Takes the place of Blender's question whether the user has pressed Esc."""

    def __init__(self, monkeypatch, escape_at_step=None):
        self.progress = []
        self.longest_s = 0.0
        self._escape_at_step, self._busy = escape_at_step, time.thread_time()
        self.is_escaped = False
        self.count = self.steps = 0
        run = BackgroundWork.run
        monkeypatch.setattr(
            BackgroundWork,
            "run",
            lambda work, task, *_: run(work, partial(self._count_steps, task), self.ask, self.progress.append),
        )

    def _count_steps(self, task, should_stop):
        """The task, whose questions are its steps; at that of the escape it waits until Esc is seen."""

        def stop():
            self.steps += 1
            while self.steps == self._escape_at_step and not self.is_escaped:
                time.sleep(0.01)
            return should_stop()

        return task(stop)

    def ask(self):
        busy = time.thread_time()
        if self.count:  # the first question ends the opening of the render, which is Blender's
            self.longest_s = max(self.longest_s, busy - self._busy)
        self._busy = busy
        self.count += 1
        self.is_escaped = self._escape_at_step is not None and self.steps >= self._escape_at_step
        return self.is_escaped


@pytest.fixture
def scene_4k(hand_scene):
    """The hand fills the frame."""
    hand_scene.livehand.light = "CAPTURE"
    hand_scene.render.resolution_x, hand_scene.render.resolution_y = SIZE_PX
    hand_scene.camera.location.z = 0.22
    find_hands(hand_scene)[0].rotation_euler.z = 1.5
    bpy.context.view_layer.update()
    return hand_scene


@pytest.mark.parametrize("escape_at_step", [1, 12])
def test_a_4k_render_is_cancelled_at_once_at_any_stage(scene_4k, monkeypatch, escape_at_step):
    questions = Questions(monkeypatch, escape_at_step)
    bpy.ops.render.render()
    assert questions.is_escaped
    busy = time.thread_time() - questions._busy
    assert busy < CANCELLED_S
    assert questions.longest_s < BUSY_S
    monkeypatch.undo()
    LiveHandRender.background.run(lambda _: None)  # waits for what was cancelled


def test_the_user_is_asked_and_progress_moves_while_a_stage_is_silent(
    scene_4k, fake_session, fake_renderer, monkeypatch
):
    scene_4k.render.resolution_percentage = 50
    render = fake_renderer.render

    def slow(self, shot, should_stop):
        for _ in range(12):
            should_stop()
            time.sleep(0.06)
        time.sleep(0.6)
        return render(self, shot)

    monkeypatch.setattr(fake_renderer, "render", slow)
    # Its progress is a share of the questions of the render before, which other tests may have left.
    background = BackgroundWork()
    monkeypatch.setattr(LiveHandRender, "background", background)
    questions = Questions(monkeypatch)
    bpy.ops.render.render()
    background.close()
    assert questions.count > 12
    assert len(set(questions.progress)) > 4
    assert questions.longest_s < BUSY_S
