"""The frame queue: prefetched frames are rendered in advance, used only if they fit, and one at a time."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import empty_frame
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.frame_queue import FrameQueue
from livehand.backend.render.frame_task import FrameTask, HandTask

SECONDS = 10  # no test waits that long unless it fails


class Recorder:
    """Renders empty frames; records when it begins one, and waits in those that `hold` names."""

    avatar = hand = None
    is_relightable = False
    mean_albedo = None
    renders_at_once = False

    def __init__(self, frames_at_once=1):
        self.frames_at_once = frames_at_once
        self.thread_counts = []
        self.begun = {}
        self.held = {}
        self.kept = []
        self.stopped = []
        self.threads = []
        self.broken = set()
        self._is_free = threading.Semaphore(frames_at_once)

    def posed_surface(self, shot):
        return None

    def hold(self, shot):
        self.begun[id(shot)], self.held[id(shot)] = threading.Event(), threading.Event()
        self.kept.append(shot)  # so that its id stays unique
        return shot

    def has_begun(self, shot):
        return self.begun[id(shot)].wait(SECONDS)

    def release(self, shot):
        self.held[id(shot)].set()

    def render(self, shot, should_stop):
        assert self._is_free.acquire(blocking=False), "too many renders at once"
        self.thread_counts.append(torch.get_num_threads())
        try:
            return self._render(shot, should_stop)
        finally:
            self._is_free.release()

    def _render(self, shot, should_stop):
        self.threads.append(threading.current_thread())
        if id(shot) in self.begun:
            self.begun[id(shot)].set()
            for _ in range(1000 * SECONDS):
                if should_stop():
                    self.stopped.append(shot)
                    break
                if self.held[id(shot)].wait(0.001):
                    break
        if id(shot) in self.broken:
            raise LiveHandError("the avatar is of another hand")
        return empty_frame(shot.camera.size_px)


@pytest.fixture
def renderer():
    return Recorder()


@pytest.fixture
def queue():
    with FrameQueue() as queue:
        yield queue


def shot_of(x):
    """A shot that differs from those of other x."""
    camera = Camera(np.diag([50, 50, 1.0]), np.eye(4), (4, 3))
    return Shot(HandPose.rest(), np.full((5, 3), float(x)), camera)


def task_of(renderer, shot):
    """One hand in a sharp frame."""
    return FrameTask(((HandTask(renderer, shot),),))


def test_the_next_frame_is_rendered_before_it_is_submitted(queue, renderer):
    held = renderer.hold(shot_of(2))
    queue.begin(1, 2)
    first = queue.submit(task_of(renderer, shot_of(1)))
    queue.prefetch(task_of(renderer, held))
    first.result(SECONDS)
    assert renderer.has_begun(held)  # while frame 1 is still the current one
    queue.begin(2, None)
    second = queue.submit(task_of(renderer, shot_of(2)))
    renderer.release(held)
    second.result(SECONDS)
    assert len(renderer.threads) == 2
    assert threading.current_thread() not in renderer.threads


def test_frames_are_rendered_one_at_a_time_and_in_order(queue, renderer):
    one, two = renderer.hold(shot_of(1)), renderer.hold(shot_of(2))
    queue.begin(1, 2)
    first = queue.submit(task_of(renderer, one))
    queue.prefetch(task_of(renderer, two))
    assert renderer.has_begun(one)
    assert not renderer.begun[id(two)].is_set()
    renderer.release(one)
    first.result(SECONDS)
    assert renderer.has_begun(two)
    renderer.release(two)
    assert len(set(renderer.threads)) == 1


def test_frames_of_a_renderer_that_gains_by_it_are_rendered_at_once_and_share_the_threads(monkeypatch):
    monkeypatch.setattr("livehand.backend.render.frame_queue.usable_threads", lambda: 6)
    renderer = Recorder(frames_at_once=2)
    held = [renderer.hold(shot_of(number)) for number in (1, 2, 3)]
    with FrameQueue() as queue:
        queue.begin(1, 2)
        first = queue.submit(task_of(renderer, held[0]))
        queue.prefetch(task_of(renderer, held[1]))
        assert renderer.has_begun(held[0])
        assert renderer.has_begun(held[1])  # while the first is still rendered
        assert renderer.thread_counts == [3, 3]
        renderer.release(held[0])
        first.result(SECONDS)
        queue.begin(2, 3)
        queue.prefetch(task_of(renderer, held[2]))
        second = queue.submit(task_of(renderer, shot_of(2)))
        assert renderer.has_begun(held[2])
        for shot in held[1:]:
            renderer.release(shot)
        second.result(SECONDS)
    assert len(renderer.threads) == 3


def test_a_frame_that_nothing_follows_has_all_threads(monkeypatch):
    monkeypatch.setattr("livehand.backend.render.frame_queue.usable_threads", lambda: 6)
    renderer = Recorder(frames_at_once=2)
    with FrameQueue() as queue:
        queue.begin(1, None)
        queue.submit(task_of(renderer, shot_of(1))).result(SECONDS)
    assert renderer.thread_counts == [6]


def test_one_core_renders_one_frame_at_a_time(monkeypatch):
    monkeypatch.setattr("livehand.backend.render.frame_queue.usable_threads", lambda: 1)
    renderer = Recorder(frames_at_once=2)
    one, two = renderer.hold(shot_of(1)), renderer.hold(shot_of(2))
    with FrameQueue() as queue:
        queue.begin(1, 2)
        queue.submit(task_of(renderer, one))
        queue.prefetch(task_of(renderer, two))
        assert renderer.has_begun(one)
        assert not renderer.begun[id(two)].wait(0.2)
        renderer.release(one)
        renderer.release(two)
        assert renderer.has_begun(two)


def nudged(values):
    """The next float after the first number."""
    values = np.array(values, np.float64)
    values.flat[0] = np.nextafter(values.flat[0], np.inf)
    return values


def other_pose(shot, **values):
    return replace(shot, pose=replace(shot.pose, **values))


def other_camera(shot, **values):
    return replace(shot, camera=replace(shot.camera, **values))


@pytest.mark.parametrize(
    "change",
    [
        lambda shot: other_pose(shot, theta=nudged(shot.pose.theta)),
        lambda shot: other_pose(shot, beta=nudged(shot.pose.beta)),
        lambda shot: other_pose(shot, transl=nudged(shot.pose.transl)),
        lambda shot: other_pose(shot, side="left"),
        lambda shot: other_camera(shot, K=nudged(shot.camera.K)),
        lambda shot: other_camera(shot, cam2world=nudged(shot.camera.cam2world)),
        lambda shot: other_camera(shot, size_px=(4, 4)),
        lambda shot: replace(shot, vertices=nudged(shot.vertices)),
    ],
)
def test_a_guess_that_differs_in_one_number_is_not_used(queue, renderer, change):
    task = task_of(renderer, shot_of(2))
    queue.begin(1, 2)
    queue.prefetch(task_of(renderer, change(shot_of(2))))
    queue.begin(2, None)
    ((frame,),) = queue.submit(task).result(SECONDS)
    assert frame.alpha.shape == (3, 4)
    assert len(renderer.threads) == 2


def test_an_equal_shot_of_another_renderer_is_not_used(queue, renderer):
    other = Recorder()
    queue.begin(1, 2)
    queue.prefetch(task_of(other, shot_of(2)))
    queue.begin(2, None)
    queue.submit(task_of(renderer, shot_of(2))).result(SECONDS)
    assert len(renderer.threads) == 1


def test_a_task_that_is_submitted_twice_is_rendered_once(queue, renderer):
    queue.begin(1, None)
    results = [queue.submit(task_of(renderer, shot_of(1))).result(SECONDS) for _ in range(2)]
    assert results[0] is results[1]
    assert len(renderer.threads) == 1


def test_equal_tasks_of_two_frames_are_each_rendered(queue, renderer):
    for frame in (1, 2):
        queue.begin(frame, None)
        queue.submit(task_of(renderer, shot_of(1))).result(SECONDS)
    assert len(renderer.threads) == 2


def test_an_error_belongs_to_its_own_frame(queue, renderer):
    broken = shot_of(2)
    renderer.broken.add(id(broken))
    queue.begin(1, 2)
    first = queue.submit(task_of(renderer, shot_of(1)))
    queue.prefetch(task_of(renderer, broken))
    assert first.result(SECONDS)
    queue.begin(2, None)
    with pytest.raises(LiveHandError, match="another hand"):
        queue.submit(task_of(renderer, broken)).result(SECONDS)


def test_two_wrong_guesses_in_a_row_end_the_prefetching(queue, renderer):
    def pass_frame(number, is_right):
        queue.begin(number, number + 1)
        queue.submit(task_of(renderer, shot_of(number))).result(SECONDS)
        queue.prefetch(task_of(renderer, shot_of(number + 1 if is_right else 0)))
        return queue.prefetchable_frame

    frames = [pass_frame(n, is_right) for n, is_right in enumerate((False, True, False, False), 1)]
    assert frames == [2, 3, 4, 5]
    assert pass_frame(5, is_right=True) is None


def test_a_prefetched_frame_that_is_never_submitted_is_dropped(queue, renderer):
    running, waiting = renderer.hold(shot_of(2)), renderer.hold(shot_of(3))
    queue.begin(1, 2)
    queue.prefetch(task_of(renderer, running))
    queue.prefetch(task_of(renderer, waiting))
    assert renderer.has_begun(running)
    queue.begin(7, None)  # stops the running one; the waiting one never begins
    assert queue.submit(task_of(renderer, shot_of(7))).result(SECONDS)
    assert renderer.stopped == [running]
    assert not renderer.begun[id(waiting)].is_set()


def test_leaving_the_queue_stops_the_running_render_and_leaves_no_thread(renderer):
    held = renderer.hold(shot_of(1))
    with FrameQueue() as queue:
        queue.begin(1, None)
        queue.submit(task_of(renderer, held))
        assert renderer.has_begun(held)
    assert not renderer.threads[0].is_alive()
    assert renderer.stopped == [held]
