"""Which case renders when, and ratios over rounds, with invented costs."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.records.camera import Camera
from livehand.backend.records.shot import HandPose
from livehand.backend.research.benchmark.motion import MotionFrame
from livehand.backend.research.benchmark.rounds import Case, measure_rounds, paired_ratio, stage_spreads
from livehand.backend.research.benchmark.stopwatch import Cost

CAMERA = Camera(np.eye(3), np.eye(4), (4, 4))


def of_ms(*values):
    return {number: {"all": Cost(value, value / 1000)} for number, value in enumerate(values)}


def test_ratios_compare_the_same_rounds():
    """A busy round slows both down, which the median of paired ratios does not see."""
    fast, slow = of_ms(10.0, 50.0, 10.0, 10.0), {1: of_ms(0, 200.0)[1], 2: of_ms(0, 0, 40.0)[2]}
    assert paired_ratio(slow, fast) == pytest.approx(4)
    assert paired_ratio({}, fast) is None
    assert paired_ratio({7: slow[1]}, fast) is None


def test_the_spread_of_a_stage_covers_the_frames_that_report_it():
    taken = {0: {"pose": Cost(1.0, 0.0)}, 1: {"pose": Cost(3.0, 0.0), "field": Cost(8.0, 0.0)}}
    assert {name: wall.median for name, (wall, _) in stage_spreads(taken).items()} == {"pose": 2, "field": 8}


def run_rounds(cases, count):
    """Rounds whose frames differ in their translation."""
    poses = [replace(HandPose.rest(), transl=np.array([float(k), 0, 0])) for k in range(count)]
    return measure_rounds(cases, [MotionFrame(pose, CAMERA) for pose in poses])


def case_of(log, name, wall_ms=1000.0, **kwargs):
    def measure(frame):
        log.append((name, frame.pose.transl[0]))
        return {"all": Cost(wall_ms, 1.0)}

    return Case(name, measure, **kwargs)


def test_cases_take_turns_and_each_round_begins_with_another():
    log = []
    results = run_rounds([case_of(log, name) for name in "ab"], 3)
    assert log == [("a", 0), ("b", 0), ("b", 1), ("a", 1), ("a", 2), ("b", 2)]
    assert [sorted(taken) for taken in results.values()] == [[0, 1, 2]] * 2


def test_a_case_over_its_budget_stops_after_two_frames_at_least():
    log = []
    cases = [case_of(log, "slow", budget_s=0.5), case_of(log, "dear", budget_s=3.5), case_of(log, "free")]
    results = run_rounds(cases, 8)
    assert {name: len(taken) for name, taken in results.items()} == {"slow": 2, "dear": 4, "free": 8}


def test_a_case_that_evicts_caches_gives_the_others_an_untimed_frame():
    log = []
    cases = [case_of(log, "a"), case_of(log, "cycles", frames=1, evicts_caches=True)]
    results = run_rounds(cases, 2)
    assert log == [("a", 0), ("a", 0), ("cycles", 0), ("a", 1)]
    assert {name: list(taken) for name, taken in results.items()} == {"a": [0, 1], "cycles": [0]}


@pytest.mark.parametrize(("frames", "rounds"), [(2, [0, 4]), (3, [0, 3, 6]), (20, list(range(8)))])
def test_the_frames_of_a_case_are_spread_over_the_rounds(frames, rounds):
    results = run_rounds([case_of([], "cycles", frames=frames)], 8)
    assert list(results["cycles"]) == rounds
