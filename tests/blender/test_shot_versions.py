"""A resumed clip is one clip: frames that stay and are of another version are told, counted and refused."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.batch import workers
from livehand.backend.batch.report import RunReport
from livehand.backend.batch.workers import run_workers
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.command import OTHER_VERSION
from livehand.livehand_blender import cli
from livehand.livehand_blender.render import sequence


@pytest.fixture
def avatars(tmp_path):
    paths = [tmp_path / f"{name}.safetensors" for name in ("one", "other")]
    for path, person in zip(paths, ("lena", "mei"), strict=True):
        shutil.copy(shipped_avatar_path(person), path)
    return paths


@pytest.fixture
def render(shot_path, tmp_path, fake_session, capsys):
    """A function: run the command into `out`; returns its exit code, its last line, and stderr."""

    def run(*arguments):
        capsys.readouterr()
        code = cli.main(["render", str(shot_path), "-o", str(tmp_path / "out"), "--json", *map(str, arguments)])
        out, err = capsys.readouterr()
        return code, json.loads(out.splitlines()[-1]), err

    return run


def save_again(shot_path):
    bpy.ops.wm.open_mainfile(filepath=str(shot_path))
    bpy.context.scene.camera.location.x -= 0.01
    bpy.ops.wm.save_mainfile()


def test_another_avatar_is_told_with_counts_and_refused_under_strict(render, avatars, tmp_path):
    one, other = avatars
    assert render("--frames", "1-2", "--avatar", one)[0] == 0
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert len(before) == 4
    code, result, err = render("--avatar", other, "--strict")
    assert code == OTHER_VERSION == 3
    assert (result["written"], result["skipped"], result["of_other_versions"]) == (0, 2, 2)
    assert "warning: 2 frames are of another avatar; --overwrite renders them again" in err
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    code, result, err = render("--avatar", other)
    assert (code, result["written"], result["of_other_versions"]) == (0, 1, 2)
    assert "warning: 2 frames are of another avatar" in err
    code, result, err = render("--avatar", other, "--overwrite", "--strict")
    assert (code, result["written"], result["of_other_versions"], err) == (0, 3, 0, "")
    code, result, err = render("--avatar", other, "--strict")
    assert (code, result["skipped"], err) == (0, 3, "")


@pytest.mark.parametrize(
    ("change", "reported"),
    [("shot", "another state of the .blend"), ("linked", "other linked files"), ("settings", "other settings")],
)
def test_an_edited_shot_a_changed_texture_and_other_settings_are_told(render, shot_path, tmp_path, change, reported):
    texture = tmp_path / "sky.png"
    bpy.data.images.new("sky", 4, 4).save(filepath=str(texture))
    image = bpy.data.images.load(str(texture))
    image.use_fake_user = True
    bpy.ops.wm.save_mainfile()
    assert render()[0] == 0
    assert render()[2] == ""
    if change == "shot":
        save_again(shot_path)
    elif change == "linked":
        texture.write_bytes(texture.read_bytes() + b" ")
    code, result, err = render(*(["--precision", "bf16"] if change == "settings" else []))
    assert (code, result["skipped"], result["of_other_versions"]) == (0, 3, 3)
    assert f"3 frames are of {reported};" in err


def test_frames_of_a_sequence_and_of_tiles_are_known_by_names_and_sizes(render, tmp_path):
    pixels = bpy.data.images.new("pixels", 4, 4)
    for name in ("film_0001", "film_0002", "tile.1001", "tile.1002"):
        pixels.save(filepath=str(tmp_path / f"{name}.png"))
    for first, source in (("film_0001.png", "SEQUENCE"), ("tile.<UDIM>.png", "TILED")):
        image = bpy.data.images.new(first, 4, 4)
        image.source = "FILE"
        image.filepath, image.source, image.use_fake_user = str(tmp_path / first), source, True
    bpy.ops.wm.save_mainfile()
    assert render("--frames", "1")[0] == 0
    assert render("--frames", "1")[1]["of_other_versions"] == 0
    for name in ("film_0002.png", "tile.1002.png"):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole + b" ")
        assert "1 frame is of other linked files" in render("--frames", "1")[2]
        (tmp_path / name).write_bytes(whole)
    assert render("--frames", "1")[2] == ""


def test_frames_that_the_shot_itself_reads_do_not_count(render, tmp_path):
    image = bpy.data.images.new("last", 4, 4)
    image.source = "FILE"
    image.filepath, image.source, image.use_fake_user = str(tmp_path / "out" / "wave_0001.exr"), "SEQUENCE", True
    bpy.ops.wm.save_mainfile()
    assert render("--frames", "1")[0] == 0
    assert render("--frames", "1-2", "--strict")[::2] == (0, "")


def test_a_format_that_is_added_leaves_the_record_of_the_other_file_as_it_is(render, avatars, tmp_path):
    one, other = avatars
    record = tmp_path / "out" / "wave_0001.json"
    assert render("--frames", "1", "--avatar", one)[0] == 0
    before = json.loads(record.read_text())
    code, result, err = render("--frames", "1", "--avatar", other, "--format", "exr,png")
    assert (code, result["written"], result["of_other_versions"]) == (0, 1, 1)
    assert "1 frame is of another avatar" in err
    after = json.loads(record.read_text())
    (added,) = after.pop("added")
    assert after == before
    assert (after["formats"], added["formats"]) == (["exr"], ["png"])
    assert [one["hands"][0]["avatar"]["path"] for one in (after, added)] == [str(one), str(other)]
    assert render("--frames", "1", "--avatar", other, "--format", "png", "--strict")[0] == 0
    assert render("--frames", "1", "--avatar", one, "--strict")[0] == 0
    assert render("--frames", "1", "--avatar", other, "--format", "exr,png", "--overwrite")[0] == 0
    assert json.loads(record.read_text()) == {**added, "formats": ["exr", "png"]}


def test_a_frame_without_a_record_is_of_unknown_origin(render, tmp_path):
    assert render("--frames", "1")[0] == 0
    (tmp_path / "out" / "wave_0001.json").unlink()
    code, result, err = render("--frames", "1", "--strict")
    assert (code, result["skipped"]) == (3, 1)
    assert "1 frame is of unknown origin" in err


def test_a_shot_that_is_saved_while_it_is_opened_is_an_error(render, shot_path, monkeypatch):
    opened = sequence.open_shot

    def open_and_save(path):
        scene = opened(path)
        shot_path.write_bytes(shot_path.read_bytes() + b"1")
        return scene

    monkeypatch.setattr(sequence, "open_shot", open_and_save)
    code, result, err = render()
    assert (code, result["written"]) == (1, 0)
    assert re.search("must stay while it is opened, it was saved meanwhile", err)


WORKER = """
import json, os, sys
event = {"event": "shot", "file": "wave.blend", "folder": "out", "frames": 3, "version": str(os.getpid())}
print(json.dumps(event), flush=True)
sys.stdin.read(1)
"""


def test_workers_that_open_two_versions_are_stopped(tmp_path, monkeypatch):
    script = tmp_path / "worker.py"
    script.write_text(WORKER)
    shot = Path("wave.blend")
    monkeypatch.setattr(workers, "_this_program", lambda argv: [sys.executable, str(script)])
    report = RunReport({shot: tmp_path}, tmp_path, as_json=True)
    with pytest.raises(LiveHandError, match=r"wave\.blend .* must stay as they are .* opened 2 versions"):
        run_workers([], 2, 0, report)


def test_workers_refuse_under_strict_and_say_so_once(shot_path, tmp_path, avatars):
    program = Path(__file__).parent / "fake_livehand.py"

    def run(*arguments):
        command = [sys.executable, program, "render", shot_path, "-o", tmp_path / "out", *arguments]
        return subprocess.run([str(one) for one in command], capture_output=True, text=True, timeout=120, check=False)

    assert run("--frames", "1-2").returncode == 0
    done = run("--avatar", avatars[0], "--strict", "--jobs", "2")
    assert done.returncode == 3, done
    assert done.stderr.count("\n") == done.stderr.count("warning: 2 frames are of another avatar;") == 1
    assert not (tmp_path / "out" / "wave_0003.exr").exists()
