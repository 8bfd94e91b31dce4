"""PNGs and EXRs are written while the next frames render: in order, none lost, and failures are told."""

import threading

import numpy as np
import pytest
from livehand.backend.capture.exr import read_exr
from livehand.backend.image import frame_writer
from livehand.backend.image.frame_writer import FileWriter, write_png
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import Frame
from PIL import Image

WAIT_S = 20


def frame_of(value):
    """4 x 3 px, half of them seen."""
    alpha = np.zeros((3, 4), np.float32)
    alpha[:, 1:3] = 1
    return Frame(np.full((3, 4, 3), value, np.float32) * alpha[..., None], alpha, alpha)


@pytest.fixture
def gate(monkeypatch):
    """Encoding waits until it is opened."""
    gate, save = threading.Event(), frame_writer._save

    def held(*image):
        assert gate.wait(WAIT_S)
        save(*image)

    monkeypatch.setattr(frame_writer, "_save", held)
    yield gate
    gate.set()


@pytest.mark.parametrize("threads", [None, 1, 3])
def test_all_are_written_as_one_by_one_and_followed_up_in_order(tmp_path, threads):
    numbers, followed = range(12), []
    with FileWriter(threads) as writer:
        for number in numbers:
            path = tmp_path / f"{number}.png"
            writer.write(frame_of(number / 12), path, lambda n=number, p=path: followed.append((n, p.is_file())))
    assert followed == [(number, True) for number in numbers]
    for number in numbers:
        write_png(frame_of(number / 12), tmp_path / "again.png")
        ours, alone = (Image.open(tmp_path / f"{name}.png") for name in (number, "again"))
        assert ours.mode == "RGBA"
        np.testing.assert_array_equal(np.asarray(ours), np.asarray(alone))


def test_nobody_waits_for_a_picture_until_too_many_are_waiting(tmp_path, gate):
    followed, rendered = [], []

    def render():
        with FileWriter(threads=1) as writer:
            for number in range(4):
                rendered.append(number)
                writer.write(frame_of(0.5), tmp_path / f"{number}.png", lambda n=number: followed.append(n))

    thread = threading.Thread(target=render)
    thread.start()
    thread.join(0.5)
    assert thread.is_alive()
    assert rendered == [0, 1, 2]  # two are waiting, and the third is waited for
    assert followed == []
    gate.set()
    thread.join(WAIT_S)
    assert followed == [0, 1, 2, 3]


def test_a_picture_that_cannot_be_written_is_told_and_the_others_are_kept(tmp_path, gate):
    (tmp_path / "no folder").write_text("")
    followed = []

    def write():
        with FileWriter(threads=2) as writer:
            for number, folder in enumerate((tmp_path, tmp_path / "no folder", tmp_path)):
                writer.write(frame_of(0.5), folder / f"{number}.png", lambda n=number: followed.append(n))
            gate.set()

    with pytest.raises(LiveHandError, match="no folder"):
        write()
    assert followed == [0, 2]
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["0.png", "2.png"]


def test_a_file_is_sealed_where_it_was_written_before_anything_follows(tmp_path):
    events = []

    def seal(path):
        events.append(("sealed", path.is_file(), threading.current_thread() is threading.main_thread()))

    with FileWriter() as writer:
        writer.write(frame_of(0.5), tmp_path / "a.png", lambda: events.append("followed"), seal=seal)
    assert events == [("sealed", True, False), "followed"]


def test_a_seal_that_fails_is_told(tmp_path):
    def seal(path):
        raise LiveHandError("no key")

    def write():
        with FileWriter() as writer:
            writer.write(frame_of(0.5), tmp_path / "a.png", lambda: followed.append(0), seal=seal)

    followed = []
    with pytest.raises(LiveHandError, match="no key"):
        write()
    assert not followed


def test_the_next_frame_is_told_of_a_picture_that_could_not_be_written(tmp_path):
    (tmp_path / "no folder").write_text("")

    def write():
        with FileWriter(threads=1) as writer:
            for number in range(100):
                writer.write(frame_of(0.5), tmp_path / "no folder" / f"{number}.png")
                rendered.append(number)

    rendered = []
    with pytest.raises(LiveHandError, match="no folder"):
        write()
    assert len(rendered) <= 2


def test_who_stops_keeps_what_was_rendered(tmp_path, gate):
    (tmp_path / "no folder").write_text("")

    def write():
        with FileWriter(threads=2) as writer:
            for folder in (tmp_path / "no folder", tmp_path):
                writer.write(frame_of(0.5), folder / "a.png")
            gate.set()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert (tmp_path / "a.png").is_file()


def test_an_exr_holds_linear_colours_alpha_and_depth(tmp_path):
    bright = frame_of(1e6)
    with FileWriter() as writer:
        for number, frame in enumerate((frame_of(0.3), bright)):
            writer.write(frame, tmp_path / f"{number}.exr")
    for number, value in ((0, np.float16(0.3)), (1, 65504)):
        channels = read_exr(tmp_path / f"{number}.exr")
        assert {name: values.dtype for name, values in channels.items()} == dict.fromkeys("RGBA", np.float16) | {
            "Z": np.float32
        }
        for name in "RGB":
            np.testing.assert_array_equal(channels[name], value * bright.alpha)
        np.testing.assert_array_equal(channels["A"], bright.alpha)
        np.testing.assert_array_equal(channels["Z"], bright.depth)
