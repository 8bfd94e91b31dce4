"""The `livehand` program: exit codes, messages, and the JSON line. Each run is a process of its own."""

import json
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.compute.kernels.cache_folder import kernel_folder_name
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.system.command import parse_size_px
from livehand.livehand_blender import cli
from livehand.livehand_blender.render.command import parse_formats
from PIL import Image

FAKE_PROGRAM = Path(__file__).parent / "fake_livehand.py"


def run_program(*arguments, program=(FAKE_PROGRAM,), **more_env):
    command = [sys.executable, *map(str, program), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, env=os.environ | more_env, check=False)


@pytest.fixture
def shot_path(hand_scene, tmp_path):
    hand_scene.frame_start, hand_scene.frame_end = 1, 2
    path = tmp_path / "wave.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_render_ends_with_one_json_line(shot_path, tmp_path):
    done = run_program("render", shot_path, "-o", tmp_path / "out", "--format", "exr,png", "--json")
    assert done.returncode == 0, done.stderr
    *progress, last = done.stdout.splitlines()
    result = json.loads(last)
    assert set(result) == {"folder", "frames", "written", "skipped", "left", "seconds_per_frame", "files"} | {
        "of_other_versions"
    }
    assert result["folder"] == str(tmp_path / "out")
    assert (result["frames"], result["written"], result["skipped"]) == (2, 2, 0)
    shot, *frames = map(json.loads, progress)
    assert len(shot.pop("version")) == 64
    assert shot == {"event": "shot", "file": str(shot_path), "folder": str(tmp_path / "out"), "frames": 2}
    assert all(frame.pop("seconds") > 0 for frame in frames)
    assert frames == [
        {"event": "frame", "file": str(shot_path), "frame": n, "number": n, "count": 2, "state": "written"}
        for n in (1, 2)
    ]
    assert len(list((tmp_path / "out").glob("wave_000?.???"))) == 4


def test_the_last_line_names_folder_frames_and_seconds(shot_path, tmp_path):
    out = tmp_path / "out"
    run_program("render", shot_path, "-o", out, "--frames", "1")
    done = run_program("render", shot_path, "-o", out)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "frame 1 (1/2): already there"
    assert done.stdout.splitlines()[-1].startswith(f"{out}: 2 frames (1 written, 1 already there), ")
    assert done.stdout.splitlines()[-1].endswith(" s/frame")


@pytest.mark.parametrize("frames", ["", "1-", "5-3", "a", "1,,2", "1.5"])
def test_a_malformed_or_empty_frame_range_is_a_usage_error(capsys, frames):
    assert cli.main(["render", "x.blend", "-o", "out", f"--frames={frames}"]) == 2
    assert "--frames" in capsys.readouterr().err


@pytest.mark.parametrize("size", ["0x10", "10", "axb", "3x512", "-4x4"])
def test_a_bad_size_is_a_usage_error(capsys, size):
    assert cli.main(["render", "x.blend", "-o", "out", f"--size={size}"]) == 2
    assert "--size" in capsys.readouterr().err


def test_no_command_is_a_usage_error(capsys):
    assert cli.main([]) == 2
    assert "COMMAND" in capsys.readouterr().err


def test_sizes_and_formats_are_read():
    assert parse_size_px("334x512") == (334, 512)
    assert parse_formats("png,exr,png") == ("png", "exr")
    assert parse_size_px("65536x2048") == (65536, 2048)


def test_a_size_of_gigabytes_is_a_usage_error(tmp_path, capsys):
    assert cli.main(["render", "x.blend", "-o", str(tmp_path / "out"), "--size", "65536x65536"]) == 2
    assert "must have at most 134217728 pixels, got '65536x65536'" in capsys.readouterr().err


def test_a_scene_of_gigabytes_is_an_error(hand_scene, shot_path, tmp_path, fake_session, capsys):
    hand_scene.render.resolution_x = hand_scene.render.resolution_y = 65536
    bpy.ops.wm.save_mainfile()
    arguments = ["render", str(shot_path), "-o", str(tmp_path / "out"), "--frames", "1"]
    assert cli.main(arguments) == 1
    assert "a frame must have at most 134217728 pixels, got 65536 x 65536" in capsys.readouterr().err
    assert cli.main([*arguments, "--size", "48x64"]) == 0


def no_hand(scene, path):
    for obj in [obj for obj in scene.objects if obj.type != "CAMERA"]:
        bpy.data.objects.remove(obj)
    bpy.ops.wm.save_mainfile()


def no_camera(scene, path):
    scene.camera = None
    bpy.ops.wm.save_mainfile()


def panoramic(scene, path):
    scene.camera.data.type = "PANO"
    bpy.ops.wm.save_mainfile()


def not_a_blend(scene, path):
    path.write_text("no blend")


def missing(scene, path):
    path.unlink()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (no_hand, "frame 1: a render needs a LiveHand hand"),
        (no_camera, "frame 1: a render needs a camera"),
        (panoramic, "perspective and orthographic cameras only"),
        (not_a_blend, "must be a .blend file"),
        (missing, "no file at"),
    ],
)
def test_bad_shots_end_with_1_one_message_and_no_files(capsys, hand_scene, shot_path, tmp_path, spoil, message):
    spoil(hand_scene, shot_path)
    capsys.readouterr()
    assert cli.main(["render", str(shot_path), "-o", str(tmp_path / "out"), "--json"]) == 1
    out, err = capsys.readouterr()
    assert err.startswith(f"livehand render: {shot_path}: ")
    assert message in err
    assert err.count("\n") == 1
    assert [file["error"] for file in json.loads(out.splitlines()[-1])["files"]] == [
        err.rstrip().partition(": ")[2].partition(": ")[2]
    ]
    assert not (tmp_path / "out").exists()


def test_an_output_folder_in_the_way_ends_with_1(capsys, shot_path, tmp_path):
    (tmp_path / "out").write_text("a file")
    assert cli.main(["render", str(shot_path), "-o", str(tmp_path / "out")]) == 1
    assert "must be writable" in capsys.readouterr().err


def test_a_mistyped_avatar_ends_with_1_and_the_names_that_ship(capsys, shot_path, tmp_path):
    assert cli.main(["render", str(shot_path), "-o", str(tmp_path / "out"), "--avatar", "Deep"]) == 1
    assert re.search("no avatar at Deep; .* light, middle, deep, lena", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_who_waits_for_kernels_to_be_compiled_is_told(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    arguments = ["render", str(tmp_path / "none.blend"), "-o", str(tmp_path / "out")]
    cli.main(arguments)
    assert "compiles kernels" in capsys.readouterr().err
    kept = tmp_path / "livehand" / kernel_folder_name() / "kernels_1" / "one.nbc"
    kept.parent.mkdir(parents=True)
    kept.touch()
    cli.main(arguments)
    assert "compiles kernels" not in capsys.readouterr().err


@pytest.fixture(scope="module")
def avatar_path(tmp_path_factory):
    """An untrained avatar of the built-in hand."""
    hand = load_default_hand()
    path = tmp_path_factory.mktemp("avatar") / "untrained.safetensors"
    save_avatar(new_avatar("untrained", hand.name, hand.sha256, PRESETS["default"]), path)
    return path


def test_the_program_renders_with_an_avatar_file(shot_path, avatar_path, tmp_path):
    arguments = ("render", shot_path, "-o", tmp_path / "out", "--avatar", avatar_path, "--format", "png", "--json")
    done = run_program(*arguments, program=("-m", "livehand.livehand_blender"))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert json.loads(done.stdout.splitlines()[-1])["written"] == 2
    assert Image.open(tmp_path / "out" / "wave_0001.png").getchannel("A").getextrema() != (0, 0)


def truncated(path):
    path.write_bytes(path.read_bytes()[:-100])


def altered(path):
    data = bytearray(path.read_bytes())
    data[-10] ^= 1
    path.write_bytes(bytes(data))


def pickled(path):
    path.write_bytes(pickle.dumps({"weights": [1.0]}))


def of_another_hand(path):
    save_avatar(new_avatar("other", "hers", "0" * 64, PRESETS["default"]), path)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (truncated, "cut short"),
        (altered, "altered or damaged"),
        (pickled, "must be a .safetensors avatar"),
        (of_another_hand, "must be given its own hand model"),
    ],
)
def test_bad_avatars_end_with_1_and_no_files(capsys, shot_path, avatar_path, tmp_path, spoil, message):
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(avatar_path.read_bytes())
    spoil(bad)
    capsys.readouterr()
    assert cli.main(["render", str(shot_path), "-o", str(tmp_path / "out"), "--avatar", str(bad)]) == 1
    out, err = capsys.readouterr()
    assert message in err
    assert (out, err.count("\n")) == ("", 1)
    assert not (tmp_path / "out").exists()


WITHOUT_BPY = """
import sys
sys.modules["bpy"] = None
from livehand.backend.system.command import parse_size_px
from livehand.livehand_blender import cli
code = cli.main(sys.argv[1:])
assert "torch" not in sys.modules
sys.exit(code)
"""


def test_help_needs_neither_blender_nor_torch():
    done = run_program("--help", program=("-c", WITHOUT_BPY))
    assert done.returncode == 0, done.stderr
    assert "render" in done.stdout


def test_render_without_blender_says_what_to_install(shot_path, tmp_path):
    done = run_program("render", shot_path, "-o", tmp_path / "out", program=("-c", WITHOUT_BPY))
    assert done.returncode == 1
    assert 'pip install "livehand[bpy]"' in done.stderr


def test_blender_and_the_process_end_cleanly(shot_path, tmp_path):
    """The real program, up to the renderer: a scene without camera. A class left registered would hang the exit."""
    bpy.context.scene.camera = None
    bpy.ops.wm.save_mainfile()
    done = run_program(
        "render",
        shot_path,
        "-o",
        tmp_path / "out",
        program=("-m", "livehand.livehand_blender"),
        PYTHONHASHSEED="0",
    )
    assert done.returncode == 1
    assert "camera" in done.stderr
    assert done.stdout == ""


CHATTER = """
import ctypes
from livehand.backend.system.command import blender_silenced
print("before")
with blender_silenced():
    print("python")
    ctypes.CDLL(None).puts(b"C, held back until the process ends")
print("after")
"""


def test_output_that_c_has_buffered_is_silenced_too():
    done = run_program(program=("-c", CHATTER), PYTHONUNBUFFERED="")  # an unbuffered C holds nothing back
    assert done.stdout == "before\nafter\n"


def test_render_takes_a_pose_file_without_any_blend(tmp_path, capsys):
    np.savez(
        tmp_path / "take.npz",
        theta=np.zeros((2, 16, 3)),
        beta=np.zeros(10),
        transl=np.zeros((2, 3)),
        fps=24.0,
        side="right",
    )
    arguments = ["render", str(tmp_path / "take.npz"), "-o", str(tmp_path / "out"), "--size", "48x64", "--json"]
    assert cli.main(arguments) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["frames"] == 2
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["0001.png", "0002.png"]
