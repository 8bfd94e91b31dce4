"""Sequences on disk: complete files only, resumed, skipped and interrupted."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.batch import frame_paths
from livehand.backend.batch.frame_file import BrokenFrameError, check_frame, is_finished, read_exr_header
from livehand.backend.batch.progress import FrameProgress, ShotTally
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.render.plan import SequencePlan
from livehand.livehand_blender.render.sequence import write_sequence
from PIL import Image

SIZE_PX = (48, 64)
FAKE_PROGRAM = Path(__file__).parent / "fake_livehand.py"


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "frames"


def names(folder):
    """All but the frames' records."""
    return sorted(path.name for path in folder.iterdir() if path.suffix != ".json")


def counts(tally):
    return tally.number_of("written"), tally.number_of("skipped")


def write(shot_path, folder, **choices):
    """Run a sequence; returns its tally and the progress of its frames."""
    tally, events = ShotTally(folder), []

    def on_event(event):
        tally.add(event)
        events.append(event)

    write_sequence(SequencePlan(shot_path, folder, **choices), on_event)
    return tally, [event for event in events if isinstance(event, FrameProgress)]


def rendered_count(session):
    return sum(len(renderer.shots) for renderer in session.made)


def test_scene_range_as_multilayer_exr(shot_path, folder, fake_session, read_exr):
    report, progress = write(shot_path, folder)
    assert names(folder) == [f"wave_{n:04d}.exr" for n in (1, 2, 3)]
    assert counts(report) == (3, 0)
    assert report.seconds_per_frame > 0
    assert [(p.frame, p.number, p.count) for p in progress] == [(1, 1, 3), (2, 2, 3), (3, 3, 3)]
    channels = read_exr(folder / "wave_0001.exr")
    assert set(channels) == {"ViewLayer.Depth.Z", *(f"ViewLayer.Combined.{c}" for c in "RGBA")}
    assert channels["ViewLayer.Depth.Z"].dtype == np.float32


def test_both_formats_come_from_one_render(shot_path, folder, fake_session, fake_renderer, read_exr):
    write(shot_path, folder, frames=(2,), formats=("exr", "png"))
    assert names(folder) == ["wave_0002.exr", "wave_0002.png"]
    assert rendered_count(fake_session) == 1
    png = np.array(Image.open(folder / "wave_0002.png")).astype(int)
    alpha = read_exr(folder / "wave_0002.exr")["ViewLayer.Combined.A"].astype(np.float64)
    assert png.shape == (64, 48, 4)
    # Half floats keep 11 bits of alpha, more than the 8 of the PNG.
    assert np.abs(png[..., 3] - alpha * 255).max() <= 0.5 + 255 * 2**-11


def test_finished_frames_are_skipped_and_broken_ones_rendered_again(shot_path, folder, fake_session):
    write(shot_path, folder)
    whole = (folder / "wave_0002.exr").read_bytes()
    (folder / "wave_0002.exr").write_bytes(whole[: len(whole) // 2])
    (folder / "wave_0003.exr").write_bytes(b"")
    untouched = (folder / "wave_0001.exr").stat().st_mtime_ns
    report, progress = write(shot_path, folder)
    assert counts(report) == (2, 1)
    assert [p.seconds is None for p in progress] == [True, False, False]
    assert (folder / "wave_0001.exr").stat().st_mtime_ns == untouched
    assert all(is_finished(folder / name, SIZE_PX) for name in names(folder))


def test_frames_of_another_size_are_rendered_again(shot_path, folder, fake_session):
    write(shot_path, folder)
    report, _ = write(shot_path, folder, size_px=(30, 40))
    assert report.number_of("written") == 3
    check_frame(folder / "wave_0001.exr", (30, 40))


def test_overwrite_renders_all(shot_path, folder, fake_session):
    write(shot_path, folder)
    report, _ = write(shot_path, folder, overwrite=True)
    assert counts(report) == (3, 0)


def test_overwriting_keeps_frames_written_since_the_run_began(shot_path, folder, fake_session):
    write(shot_path, folder)
    for frame, changed_ns in ((1, 10**18 - 1), (2, 10**18), (3, 10**18 + 1)):
        os.utime(folder / f"wave_{frame:04d}.exr", ns=(changed_ns, changed_ns))
    _, progress = write(shot_path, folder, overwrite=True, began_ns=10**18)
    assert [p.state for p in progress] == ["written", "skipped", "skipped"]


def test_a_frame_that_lacks_one_format_gets_it(shot_path, folder, fake_session):
    write(shot_path, folder, frames=(1,))
    report, _ = write(shot_path, folder, frames=(1,), formats=("exr", "png"))
    assert report.number_of("written") == 1
    assert names(folder) == ["wave_0001.exr", "wave_0001.png"]


def test_the_plans_settings_reach_the_renderer_and_not_the_file(shot_path, folder, fake_session, tmp_path):
    avatar = tmp_path / "mine.safetensors"
    shutil.copy(shipped_avatar_path("lena"), avatar)
    before = shot_path.read_bytes()
    write(shot_path, folder, frames=(1,), avatar=avatar, device="cpu", precision="bf16")
    (renderer,) = fake_session.made
    assert renderer.avatar_path == avatar
    assert (renderer.device.name, renderer.device.precision) == ("cpu", "bf16")
    assert shot_path.read_bytes() == before


def test_png_has_the_scenes_color_depth(hand_scene, shot_path, folder, fake_session):
    hand_scene.render.image_settings.file_format, hand_scene.render.image_settings.color_depth = "PNG", "16"
    bpy.ops.wm.save_mainfile()
    write(shot_path, folder, frames=(1,), formats=("exr", "png"))
    # The IHDR chunk of a PNG: bit depth is byte 24.
    assert (folder / "wave_0001.png").read_bytes()[24] == 16


def test_border_crop_sets_the_files_size(hand_scene, shot_path, folder, fake_session):
    render = hand_scene.render
    render.use_border, render.use_crop_to_border, render.border_max_x = True, True, 0.5
    bpy.ops.wm.save_mainfile()
    report, _ = write(shot_path, folder, frames=(1,))
    check_frame(folder / "wave_0001.exr", (24, 64))
    assert write(shot_path, folder, frames=(1,))[0].number_of("skipped") == 1
    assert report.number_of("written") == 1


def not_a_blend(path):
    path.write_bytes(b"PK\x03\x04 no blend")


def missing_file(path):
    path.unlink()


@pytest.mark.parametrize(
    ("spoil", "message"), [(not_a_blend, "must be a .blend file"), (missing_file, "no file at .*wave.blend")]
)
def test_bad_shot_files_leave_no_files(shot_path, folder, fake_session, spoil, message):
    spoil(shot_path)
    with pytest.raises(LiveHandError, match=message):
        write(shot_path, folder)
    assert not folder.exists()


def test_the_engines_error_is_raised_and_leaves_no_files(hand_scene, shot_path, folder, fake_session):
    hand_scene.camera = None
    bpy.ops.wm.save_mainfile()
    with pytest.raises(LiveHandError, match=r"^frame 1: .*camera"):
        write(shot_path, folder)
    assert not folder.exists()


def test_stereo_is_an_error(hand_scene, shot_path, folder, fake_session):
    hand_scene.render.use_multiview = True
    bpy.ops.wm.save_mainfile()
    with pytest.raises(LiveHandError, match="stereo"):
        write(shot_path, folder)


def test_nan_in_the_pose_is_an_error(hand_scene, shot_path, folder, fake_session):
    armature = next(obj for obj in hand_scene.objects if obj.type == "ARMATURE")
    armature.pose.bones["index1.R"].rotation_quaternion = (float("nan"), 0, 0, 0)
    bpy.ops.wm.save_mainfile()
    with pytest.raises(LiveHandError, match="finite"):
        write(shot_path, folder)
    assert not folder.exists()


def test_a_folder_that_cannot_be_made_is_an_error(shot_path, tmp_path, fake_session):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(LiveHandError, match="must be writable"):
        write(shot_path, tmp_path / "file" / "frames")


def test_a_file_that_does_not_decode_is_never_renamed(shot_path, folder, fake_session, monkeypatch):
    def refuse(path, size_px):
        raise BrokenFrameError("cut short")

    monkeypatch.setattr(frame_paths, "check_frame", refuse)
    with pytest.raises(LiveHandError, match="could not be written: cut short"):
        write(shot_path, folder)
    assert not folder.exists()


def test_every_truncation_of_a_frame_is_detected(shot_path, folder, fake_session):
    write(shot_path, folder, frames=(1,), formats=("exr", "png"))
    for path in (folder / "wave_0001.exr", folder / "wave_0001.png"):
        whole = path.read_bytes()
        for length in (0, 1, 4, 300, len(whole) // 3, len(whole) // 2, len(whole) - 13, len(whole) - 1):
            path.write_bytes(whole[:length])
            assert not is_finished(path, SIZE_PX), (path.name, length)
        path.write_bytes(whole)
        assert is_finished(path, SIZE_PX)


def test_a_truncated_uncompressed_chunk_is_detected(shot_path, folder, fake_session):
    write(shot_path, folder, frames=(1,), size_px=(48, 16))
    path = folder / "wave_0001.exr"
    data = path.read_bytes()
    parts, position = read_exr_header(data)  # Blender 5 writes a part for each pass
    assert {part.chunk_count for part in parts} == {1}
    # A chunk that compression does not make smaller is stored uncompressed.
    last, size = int.from_bytes(data[position:][: 8 * len(parts)][-8:], "little"), parts[-1].unpacked_size(0)
    size_at = last + 4 * (1 + (len(parts) > 1))
    stored = data[:size_at] + size.to_bytes(4, "little") + bytes(size)
    path.write_bytes(stored)
    assert is_finished(path, (48, 16))
    path.write_bytes(stored[:-1])
    assert not is_finished(path, (48, 16))


@pytest.fixture
def program(shot_path, folder):
    """`livehand render` in a process of its own, 0.3 s a frame."""
    command = [sys.executable, FAKE_PROGRAM, "render", shot_path, "-o", folder, "--frames", "1-40"]
    with subprocess.Popen(
        [str(part) for part in command],
        env=os.environ | {"FAKE_SECONDS": "0.3"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        yield process
        process.kill()


def wait_for_frames(program, folder, count):
    end = time.monotonic() + 30
    while time.monotonic() < end and program.poll() is None:
        if len(list(folder.glob("wave_*.exr"))) >= count:
            return
        time.sleep(0.02)
    program.kill()
    raise AssertionError(f"no {count} frames in 30 s: {program.communicate()}")


def test_ctrl_c_ends_with_130_and_complete_files(program, folder):
    wait_for_frames(program, folder, 2)
    program.send_signal(signal.SIGINT)
    out, err = program.communicate(timeout=30)
    assert program.returncode == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err + out
    assert 2 <= len(names(folder)) < 40
    assert all(is_finished(folder / name, SIZE_PX) for name in names(folder))


def test_a_killed_run_is_resumed(program, shot_path, folder, fake_session):
    wait_for_frames(program, folder, 2)
    program.kill()
    program.communicate(timeout=30)
    kept = len([path for path in folder.glob("wave_*.exr") if is_finished(path, SIZE_PX)])
    report, _ = write(shot_path, folder, frames=range(1, 7))
    assert report.number_of("skipped") == kept
    assert names(folder) == [f"wave_{n:04d}.exr" for n in range(1, 7)]
