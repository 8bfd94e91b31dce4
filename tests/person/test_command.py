"""`livehand person` goes on after an interruption, and leaves nothing after an error."""

import argparse

import numpy as np
import pytest
from livehand.backend.person import command, making, person_avatar, sources
from livehand.backend.person.command import COMMAND, start_person
from livehand.backend.person.kept_steps import PICTURED_HAND, KeptSteps, remove_work, work_folder
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import HandPicture, PicturedHand
from livehand.backend.records.shot import HandPose


@pytest.fixture
def pictured():
    camera = Camera(np.diag([9.0, 9, 1]), np.eye(4), (4, 3))
    blank = np.zeros((3, 4, 3), np.uint8)
    return PicturedHand((HandPicture("a", blank, blank[..., 0], camera, HandPose.rest()),), "right", "photos")


@pytest.fixture
def run(tmp_path, monkeypatch, pictured):
    """A function (what the making raises, side=None): runs the command; returns how often pictures were read."""
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").write_bytes(b"1")
    reads = []

    def read(source, model, log, steps):
        reads.append(source.path)
        return pictured

    monkeypatch.setattr(sources, "_pictured_hand", read)
    monkeypatch.setattr(person_avatar, "shipped_bases", lambda model: None)

    def run(raised, *options):
        def stopped(*arguments):
            raise raised

        monkeypatch.setattr(making, "person_of_pictures", stopped)
        parser = argparse.ArgumentParser()
        COMMAND.add_arguments(parser)
        output = str(tmp_path / "anna.safetensors")
        with pytest.raises(type(raised)):
            COMMAND.run(parser.parse_args([str(tmp_path / "photos"), "-o", output, *options]))
        return len(reads)

    return run


@pytest.mark.slow
def test_an_interrupted_run_goes_on_unless_its_input_has_changed(run, tmp_path):
    assert run(KeyboardInterrupt()) == 1
    assert run(KeyboardInterrupt()) == 1
    assert run(KeyboardInterrupt(), "--side", "left") == 2
    assert run(KeyboardInterrupt(), "--side", "left") == 2
    (tmp_path / "photos" / "a.jpg").write_bytes(b"2")
    assert run(KeyboardInterrupt(), "--side", "left") == 3
    assert len(list(work_folder(tmp_path / "anna.safetensors").iterdir())) == 1


def test_an_error_of_the_pictures_leaves_nothing(run, tmp_path):
    run(KeyboardInterrupt())
    run(LiveHandError("no skin"))
    assert [path.name for path in tmp_path.iterdir()] == ["photos"]


def test_another_kind_of_sheet_is_refused_before_the_work(run, tmp_path):
    assert run(LiveHandError("--sheet must name"), "--sheet", str(tmp_path / "anna.txt")) == 0


def test_a_canceled_job_leaves_nothing(tmp_path, pictured):
    output = tmp_path / "anna.safetensors"
    KeptSteps.beside(output, {}).kept("pictures", lambda: pictured, PICTURED_HAND)
    job = start_person([str(tmp_path / "none"), "-o", str(output)])
    job.cancel()
    job.wait()
    remove_work(output)
    assert list(tmp_path.iterdir()) == []


def test_lines_tell_the_share_and_the_time_that_is_left(monkeypatch):
    now, told = [0.0], []
    monkeypatch.setattr(command.time, "monotonic", lambda: now[0])
    countdown = command.Countdown(told.append, 4)
    for now[0] in (60.0, 120.0, 180.0, 240.0, 300.0):
        countdown("a step")
    assert [one.share for one in told] == [0.25, 0.5, 0.75, 1.0, 1.0]
    assert told[0].text == "a step (25%, about 3 min left)"
    assert told[2].text == "a step (75%, about 1 min left)"
    assert told[3].text == "a step (100%)"
