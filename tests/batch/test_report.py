"""Events of a render: their JSON, their totals, and what is printed."""

import json
from pathlib import Path

import pytest
from livehand.backend.batch.progress import (
    Failed,
    FrameProgress,
    ShotOpened,
    ShotTally,
    Warned,
    from_record,
    to_record,
)
from livehand.backend.batch.report import RunReport

SHOT = Path("wave.blend")
EVENTS = (
    ShotOpened("out", 4),
    FrameProgress(1, 1, 4, "skipped"),
    Warned("image 'a' cannot be read"),
    FrameProgress(2, 2, 4, "written", 0.5),
    FrameProgress(3, 3, 4, "left"),
    Failed("no camera"),
)
OTHER = FrameProgress(4, 4, 4, "skipped", differs=("avatars", "settings"))


@pytest.mark.parametrize("event", [*EVENTS, OTHER, ShotOpened("out", 4, "5407")])
def test_an_event_survives_json(event):
    assert from_record(json.loads(json.dumps(to_record(SHOT, event)))) == (SHOT, event)


def test_a_tally_counts_each_frame_at_its_best_state():
    tally = ShotTally(Path("out"))
    assert tally.missing(with_left=False) == "all frames are"
    assert all([tally.add(event) for event in EVENTS])
    assert not any([tally.add(event) for event in EVENTS])
    assert [tally.number_of(state) for state in ("written", "skipped", "left")] == [1, 1, 1]
    assert tally.missing(with_left=False) == "1 of 4 frames are"
    assert tally.missing(with_left=True) == "2 of 4 frames are"
    assert tally.add(FrameProgress(3, 3, 4, "written", 0.7))
    assert tally.seconds_per_frame == 0.5
    assert tally.result(SHOT)["error"] == "no camera"


def test_text_has_a_line_per_frame_and_problems_on_stderr(capsys):
    report = RunReport({SHOT: Path("out")}, Path("out"), as_json=False)
    for event in (*EVENTS, *EVENTS):
        report.handler(SHOT)(event)
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "frame 1 (1/4): already there",
        "frame 2 (2/4): 0.50 s",
        "frame 3 (3/4): waiting for another process",
    ]
    assert err.splitlines() == [
        "livehand render: wave.blend: warning: image 'a' cannot be read",
        "livehand render: wave.blend: no camera",
    ]
    assert report.has_failed
    summary = report.result()["summary"]
    assert summary == ("out: 3 frames (1 written, 1 already there, 1 left to other processes), 0.50 s/frame, failed")


def test_a_worker_prints_json_only(capsys):
    report = RunReport({SHOT: Path("out")}, Path("out"), as_json=True, is_quiet=True)
    for event in EVENTS:
        report.add(SHOT, event)
    out, err = capsys.readouterr()
    assert [from_record(json.loads(line)) for line in out.splitlines()] == [(SHOT, event) for event in EVENTS]
    assert err == ""


def test_frames_of_another_version_are_named_and_counted(capsys):
    report = RunReport({SHOT: Path("out")}, Path("out"), as_json=False)
    for event in (*EVENTS[:2], OTHER):
        report.add(SHOT, event)
    assert report.compare_versions()
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "frame 4 (4/4): already there, of another avatar, of other settings"
    assert err == (
        "livehand render: wave.blend: warning: 1 frame is of another version (1 of another avatar, 1 of other "
        "settings); --overwrite renders it again, another folder keeps both\n"
    )
    assert report.result()["of_other_versions"] == 1
    report.add(SHOT, FrameProgress(4, 4, 4, "written", 0.1))  # by another worker
    assert not report.compare_versions()
