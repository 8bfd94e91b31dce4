"""The queue of a sequence: the next frame is rendered meanwhile, only taken where it fits, and one at a time."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose, Shot, empty_frame
from livehand.backend.rendering.frame_queue import FrameQueue
from livehand.backend.rendering.frame_task import HandTask

SECONDS = 10  # no test waits that long unless it fails


class Recorder:
    """Renders empty frames; tells when it begins one, and holds those it is told to hold."""

    def __init__(self):
        self.begun = {}
        self.held = {}
        self.kept = []
        self.stopped = []
        self.threads = []
        self.broken = set()
        self._is_free = threading.Lock()

    def hold(self, shot):
        self.begun[id(shot)], self.held[id(shot)] = threading.Event(), threading.Event()
        self.kept.append(shot)  # or its id would be another's
        return shot

    def has_begun(self, shot):
        return self.begun[id(shot)].wait(SECONDS)

    def release(self, shot):
        self.held[id(shot)].set()

    def render(self, shot, should_stop):
        assert self._is_free.acquire(blocking=False), "two renders at once"
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


def test_the_next_frame_is_rendered_before_it_is_asked_for(queue, renderer):
    one, two = HandTask(renderer, shot_of(1)), HandTask(renderer, renderer.hold(shot_of(2)))
    queue.begin(1, 2)
    first = queue.ask(one)
    queue.prefetch(two)
    first.result(SECONDS)
    assert renderer.has_begun(two.shot)  # while the caller still has frame 1 in hand
    queue.begin(2, None)
    second = queue.ask(HandTask(renderer, shot_of(2)))
    renderer.release(two.shot)
    second.result(SECONDS)
    assert len(renderer.threads) == 2
    assert threading.current_thread() not in renderer.threads


def test_frames_come_one_at_a_time_and_in_order(queue, renderer):
    one, two = HandTask(renderer, renderer.hold(shot_of(1))), HandTask(renderer, renderer.hold(shot_of(2)))
    queue.begin(1, 2)
    first = queue.ask(one)
    queue.prefetch(two)
    assert renderer.has_begun(one.shot)
    assert not renderer.begun[id(two.shot)].is_set()
    renderer.release(one.shot)
    first.result(SECONDS)
    assert renderer.has_begun(two.shot)
    renderer.release(two.shot)
    assert len(set(renderer.threads)) == 1


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
def test_a_guess_that_differs_in_one_number_is_not_taken(queue, renderer, change):
    asked = HandTask(renderer, shot_of(2))
    queue.begin(1, 2)
    queue.prefetch(HandTask(renderer, change(shot_of(2))))
    queue.begin(2, None)
    frame = queue.ask(asked).result(SECONDS)
    assert frame.alpha.shape == (3, 4)
    assert len(renderer.threads) == 2


def test_an_equal_shot_of_another_renderer_is_not_taken(queue, renderer):
    other = Recorder()
    queue.begin(1, 2)
    queue.prefetch(HandTask(other, shot_of(2)))
    queue.begin(2, None)
    queue.ask(HandTask(renderer, shot_of(2))).result(SECONDS)
    assert len(renderer.threads) == 1


def test_a_frame_that_is_asked_for_twice_is_rendered_once(queue, renderer):
    queue.begin(1, None)
    results = [queue.ask(HandTask(renderer, shot_of(1))).result(SECONDS) for _ in range(2)]
    assert results[0] is results[1]
    assert len(renderer.threads) == 1


def test_equal_frames_are_each_rendered(queue, renderer):
    for frame in (1, 2):
        queue.begin(frame, None)
        queue.ask(HandTask(renderer, shot_of(1))).result(SECONDS)
    assert len(renderer.threads) == 2


def test_an_error_belongs_to_its_own_frame(queue, renderer):
    broken = shot_of(2)
    renderer.broken.add(id(broken))
    queue.begin(1, 2)
    first = queue.ask(HandTask(renderer, shot_of(1)))
    queue.prefetch(HandTask(renderer, broken))
    assert first.result(SECONDS)
    queue.begin(2, None)
    with pytest.raises(LiveHandError, match="another hand"):
        queue.ask(HandTask(renderer, broken)).result(SECONDS)


def test_two_wrong_guesses_running_end_the_guessing(queue, renderer):
    def pass_frame(number, is_right):
        queue.begin(number, number + 1)
        queue.ask(HandTask(renderer, shot_of(number))).result(SECONDS)
        queue.prefetch(HandTask(renderer, shot_of(number + 1 if is_right else 0)))
        return queue.prefetchable_frame

    told = [pass_frame(n, is_right) for n, is_right in enumerate((False, True, False, False), 1)]
    assert told == [2, 3, 4, 5]
    assert pass_frame(5, is_right=True) is None


def test_what_is_foreseen_and_never_asked_for_is_dropped(queue, renderer):
    running, waiting = renderer.hold(shot_of(2)), renderer.hold(shot_of(3))
    queue.begin(1, 2)
    queue.prefetch(HandTask(renderer, running))
    queue.prefetch(HandTask(renderer, waiting))
    assert renderer.has_begun(running)
    queue.begin(7, None)  # stops the one, and the other never begins
    assert queue.ask(HandTask(renderer, shot_of(7))).result(SECONDS)
    assert renderer.stopped == [running]
    assert not renderer.begun[id(waiting)].is_set()


def test_the_end_stops_what_runs_and_leaves_no_thread(renderer):
    held = renderer.hold(shot_of(1))
    with FrameQueue() as queue:
        queue.begin(1, None)
        queue.ask(HandTask(renderer, held))
        assert renderer.has_begun(held)
    assert not renderer.threads[0].is_alive()
    assert renderer.stopped == [held]
