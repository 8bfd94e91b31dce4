"""What a run keeps beside its output: read again as it was, made anew for other inputs, gone at the end."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.motion.landmarks.take_file import FilmedTake
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand
from livehand.backend.person.kept_steps import (
    FILMED_TAKE,
    FITTED_ROUND,
    PICTURED_HAND,
    FittedRound,
    KeptSteps,
    digest_of,
    remove_work,
    work_folder,
)
from livehand.backend.records.camera import Camera
from livehand.backend.records.hand_picture import HandPicture, PicturedHand
from livehand.backend.records.shot import HandPose

RNG = np.random.default_rng(0)


def pose():
    return HandPose(RNG.normal(size=(16, 3)), RNG.normal(size=10), RNG.normal(size=3), "right", RNG.normal(size=3))


def picture(size_px, moment):
    width, height = size_px
    camera = Camera(np.diag([200.0, 210, 1]), np.eye(4), size_px)
    rgb = RNG.integers(0, 255, (height, width, 3), np.uint8)
    labels = RNG.integers(0, 3, (height, width), np.uint8)
    return HandPicture("é 1", rgb, labels, camera, pose(), 3, 1, moment == 2, (0.1, -0.2, 1 / 3), moment)


def a_round(melanin):
    return FittedRound((pose(),), (picture((4, 4), None).camera,), None, melanin)


@pytest.fixture
def hand():
    pictures = (picture((8, 6), None), picture((5, 7), 2))
    return PicturedHand(pictures, "left", "film.mp4", RNG.normal(size=9), True, ("a note",))


def assert_same(one, other):
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif hasattr(one, "__dataclass_fields__"):
        for name in one.__dataclass_fields__:
            assert_same(getattr(one, name), getattr(other, name))
    elif isinstance(one, tuple | list):
        assert len(one) == len(other)
        for pair in zip(one, other, strict=True):
            assert_same(*pair)
    elif isinstance(one, dict):
        assert_same(list(one.items()), list(other.items()))
    else:
        assert one == other


def take():
    shown = FilmedHand(np.array([0, 2]), RNG.uniform(1, 50, (2, 21, 2)), RNG.normal(0, 0.05, (2, 21, 3)))
    return FilmedTake(FilmCamera((64, 48), 70.0), np.arange(3) / 15, 15.0, {"left": shown})


def results(hand):
    return {
        "pictures": (hand, PICTURED_HAND),
        "plain": (replace(hand, offset_m=None, notes=()), PICTURED_HAND),
        "round": (FittedRound.of(hand, 1 / 3), FITTED_ROUND),
        "shapeless": (FittedRound.of(replace(hand, offset_m=None), 1 / 3), FITTED_ROUND),
        "take": (take(), FILMED_TAKE),
    }


def must_not_run():
    raise AssertionError("was done again")


def test_every_result_is_read_as_it_was(tmp_path, hand):
    steps = KeptSteps.beside(tmp_path / "a.safetensors", {"files": ["x"]})
    for name, (result, form) in results(hand).items():
        assert_same(steps.kept(name, lambda result=result: result, form), result)
        again = KeptSteps.beside(tmp_path / "a.safetensors", {"files": ["x"]})
        assert_same(again.kept(name, must_not_run, form), result)


def test_other_inputs_begin_anew_and_remove_the_old(tmp_path, hand):
    output = tmp_path / "a.safetensors"
    KeptSteps.beside(output, {"files": ["x"]}).kept("pictures", lambda: hand, PICTURED_HAND)
    other = KeptSteps.beside(output, {"files": ["y"]})
    assert list(work_folder(output).iterdir()) == []
    assert other.kept("pictures", lambda: "new", PICTURED_HAND._replace(write=lambda *_: None)) == "new"


def test_what_is_damaged_is_made_again(tmp_path, hand):
    steps = KeptSteps.beside(tmp_path / "a.safetensors", {})
    steps.kept("round", lambda: a_round(0.5), FITTED_ROUND)
    (path,) = steps.folder.iterdir()
    whole = path.read_bytes()
    for spoilt in (b"", whole[: len(whole) // 2], b"PK" + whole[2:100]):
        path.write_bytes(spoilt)
        assert steps.kept("round", lambda: a_round(0.7), FITTED_ROUND).melanin == 0.7
        assert steps.kept("round", must_not_run, FITTED_ROUND).melanin == 0.7


def test_nothing_is_left_in_the_end(tmp_path):
    output = tmp_path / "a.safetensors"
    for remove in (lambda steps: steps.remove(), lambda steps: remove_work(output)):
        steps = KeptSteps.beside(output, {})
        steps.kept("round", lambda: a_round(0.5), FITTED_ROUND)
        assert work_folder(output).is_dir()
        remove(steps)
        assert list(tmp_path.iterdir()) == []
    KeptSteps().remove()


def test_without_a_folder_nothing_is_kept():
    assert KeptSteps().kept("round", lambda: 1, FITTED_ROUND) == 1


def test_digests_tell_files_and_folders_apart(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").write_bytes(b"1")
    found = {digest_of(tmp_path / "photos")}
    (tmp_path / "photos" / "b.jpg").write_bytes(b"2")
    found.add(digest_of(tmp_path / "photos"))
    (tmp_path / "photos" / "b.jpg").write_bytes(b"3")
    found.add(digest_of(tmp_path / "photos"))
    (tmp_path / "photos" / "b.jpg").rename(tmp_path / "photos" / "c.jpg")
    found.add(digest_of(tmp_path / "photos"))
    found.add(digest_of(tmp_path / "photos" / "a.jpg"))
    assert len(found) == 5
