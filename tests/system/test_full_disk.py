"""A disk that is full: one clear error, what was there before is there still, and nothing else is left."""

import contextlib

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.capture.capture import Capture, CaptureView, save_capture_index
from livehand.backend.capture.exr import write_exr
from livehand.backend.field.field import FieldConfig
from livehand.backend.image.frame_writer import write_png
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.motion import HandMotion
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import Frame
from livehand.backend.records.shot import HandPose
from livehand.backend.research.baselines.weights_file import FILE, save_method
from livehand.backend.research.comparison.grid import save_pictures
from livehand.backend.training.checkpoint import Progress, TrainState, save_checkpoint
from livehand.livehand_blender.cli import main

resource = pytest.importorskip("resource", reason="needs limits of files' sizes")
ROOM_BYTES = 2048
NOISE = np.random.default_rng(0)


@contextlib.contextmanager
def little_room():
    """Writing more than this into a file is the same error of the system as a full disk, but for its number."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def picture(path):
    rgb, alpha = NOISE.random((64, 64, 3), np.float32), np.ones((64, 64), np.float32)
    write_png(Frame(rgb, alpha, alpha), path)


def avatar(path):
    field = FieldConfig(width=8, density_width=4, planes=((4, 1, 2),), relief=4)
    save_avatar(new_avatar("a", "hand", "0" * 64, AvatarConfig(field, SuperResConfig(width=4, depth=1))), path)


def checkpoint(path):
    module = torch.nn.Linear(64, 64)
    state = TrainState(module, torch.nn.Linear(64, 64), torch.optim.Adam(module.parameters()))
    save_checkpoint(path, state, Progress(), "run")


def index(path):
    camera = Camera(np.array([[9.0, 0, 4], [0, 9, 4], [0, 0, 1]]), np.eye(4), (8, 8))
    views = tuple(CaptureView(f"{k}.png", camera, 0, 0, "train") for k in range(50))
    save_capture_index(Capture(path.parent, "0" * 64, {}, (HandPose.rest(),), views))


WRITERS = {
    "0001.png": picture,
    "a.safetensors": avatar,
    "a.checkpoint": checkpoint,
    "transforms.json": index,
    FILE: lambda path: save_method(path.parent, "x", {"a": torch.zeros(4096)}),
    "a.exr": lambda path: write_exr(path, {"A": NOISE.random((64, 64), np.float32)}),
    "pictures.npz": lambda path: save_pictures([(NOISE.random((64, 64, 4)),) * 2], path),
    "take.npz": lambda path: write_motion(HandMotion(NOISE.random((50, 16, 3)), np.zeros(10), np.zeros((50, 3))), path),
}


@pytest.mark.parametrize("is_there", [False, True])
@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_as_before_and_the_error_names_it(tmp_path, name, is_there):
    path = tmp_path / name
    if is_there:
        path.write_text("before")
    with little_room(), pytest.raises(LiveHandError, match=rf"{path} must be writable .*File too large"):
        WRITERS[name](path)
    assert [left.name for left in tmp_path.iterdir() if left.name != "poses.npz"] == [name] * is_there
    assert not is_there or path.read_text() == "before"
    WRITERS[name](path)
    assert path.stat().st_size > ROOM_BYTES


@pytest.mark.slow
def test_a_pose_file_is_rendered_to_the_last_frame_that_fits(tmp_path, capsys):
    np.savez(tmp_path / "take.npz", theta=np.zeros((2, 16, 3)))
    command = ["render", str(tmp_path / "take.npz"), "--size", "128x128", "-o"]
    assert main([*command, str(tmp_path / "before")]) == 0  # kernels are compiled and kept while there is room
    capsys.readouterr()
    with little_room():
        assert main([*command, str(tmp_path / "out")]) == 1
    err = capsys.readouterr().err
    assert err.startswith(f"livehand render: {tmp_path / 'out' / '0001.png'} must be writable (")
    assert err.count("\n") == 1
    assert list((tmp_path / "out").iterdir()) == []
