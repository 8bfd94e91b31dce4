"""Several shots, parts of a shot, worker processes, kills and full disks: through the program."""

import json
import os
import random
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest
from livehand.backend.batch.folders import folders_of
from livehand.backend.batch.frame_file import is_finished
from livehand.backend.batch.leases import process_space
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender import cli
from livehand.livehand_blender.render.command import parse_chunk

FAKE_PROGRAM = Path(__file__).parent / "fake_livehand.py"
KILL_TEST = Path(__file__).parents[2] / "examples" / "kill_test.py"
SIZE_PX = (48, 64)


@pytest.fixture
def program(shot_path, tmp_path):
    """A function: start `livehand render` into `out`, with more arguments."""
    started = []

    def start(*arguments, seconds=0.0):
        command = [sys.executable, FAKE_PROGRAM, "render", shot_path, *arguments, "-o", tmp_path / "out"]
        process = subprocess.Popen(
            [str(part) for part in command],
            env=os.environ | {"FAKE_SECONDS": str(seconds)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def render(*arguments):
    return cli.main(["render", *map(str, arguments)])


def hidden(folder):
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def events(out):
    """The JSON events, and the result."""
    *told, result = map(json.loads, out.splitlines())
    return told, result


def test_each_of_several_shots_has_a_folder_and_a_bad_one_stops_no_other(shot_path, tmp_path, fake_session, capsys):
    other, bad = tmp_path / "other.blend", tmp_path / "bad.blend"
    shutil.copy(shot_path, other)
    bad.write_text("no blend")
    capsys.readouterr()
    assert render(bad, shot_path, other, "-o", tmp_path / "out", "--frames", "1-2", "--json") == 1
    out, err = capsys.readouterr()
    told, result = events(out)
    assert [event["event"] for event in told] == ["error", "shot", "frame", "frame", "shot", "frame", "frame"]
    assert re.fullmatch(rf"livehand render: {bad}: .* must be a .blend file.*\n", err)
    assert (result["frames"], result["written"], result["folder"]) == (4, 4, str(tmp_path / "out"))
    rows = [(file["file"], file["folder"], file["written"], file["skipped"]) for file in result["files"]]
    assert rows == [
        (str(path), str(tmp_path / "out" / path.stem), written, 0)
        for path, written in ((bad, 0), (shot_path, 2), (other, 2))
    ]
    assert "must be a .blend" in result["files"][0]["error"]
    assert [file["error"] for file in result["files"][1:]] == [None, None]
    assert sorted(path.name for path in (tmp_path / "out").rglob("*.exr")) == [
        f"{stem}_000{n}.exr" for stem in ("other", "wave") for n in (1, 2)
    ]
    assert not (tmp_path / "out" / "bad").exists()


def test_the_summary_names_what_failed(shot_path, tmp_path, fake_session, capsys):
    missing = tmp_path / "no.blend"
    capsys.readouterr()
    assert render(missing, shot_path, "-o", tmp_path / "out", "--frames", "2") == 1
    out, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert out.splitlines()[0].startswith("wave frame 2 (1/1): ")
    assert out.splitlines()[-1] == f"failed: {missing}"


def test_shots_of_one_name_are_refused_before_anything_is_rendered(tmp_path, capsys):
    assert render("a/wave.blend", "b/Wave.blend", "-o", tmp_path / "out") == 1
    assert "must differ in name" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    with pytest.raises(LiveHandError, match=r"got a\.blend and a\.blend"):
        folders_of([Path("a.blend"), Path("a.blend")], tmp_path)


@pytest.mark.parametrize("frames", [range(1, 25), range(1, 3), [5, 1, 9]])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 24])
def test_chunks_are_equal_consecutive_and_whole(frames, count):
    chunks = [parse_chunk(f"{number}/{count}").of(frames) for number in range(1, count + 1)]
    assert [frame for chunk in chunks for frame in chunk] == list(frames)
    assert max(map(len, chunks)) - min(map(len, chunks)) <= 1


@pytest.mark.parametrize("chunk", ["", "1", "0/2", "3/2", "1/0", "-1/2", "1/2/3", "a/b"])
def test_a_bad_chunk_is_a_usage_error(capsys, chunk):
    assert render("x.blend", "-o", "out", f"--chunk={chunk}") == 2
    assert "--chunk" in capsys.readouterr().err


def test_a_chunk_renders_its_part_of_the_shots_range(shot_path, tmp_path, fake_session):
    assert render(shot_path, "-o", tmp_path / "out", "--chunk", "2/2") == 0
    assert sorted(path.name for path in (tmp_path / "out").glob("*.exr")) == ["wave_0002.exr", "wave_0003.exr"]


def test_an_unreadable_texture_is_told_and_rendering_goes_on(hand_scene, shot_path, tmp_path, fake_session, capsys):
    for name, content in (("gone", None), ("empty", b""), ("fine", b"x")):
        path = tmp_path / f"{name}.png"
        if content is not None:
            path.write_bytes(content)
        image = bpy.data.images.new(name, 4, 4)
        image.source, image.filepath, image.use_fake_user = "FILE", str(path), True
    bpy.ops.wm.save_mainfile()
    capsys.readouterr()
    assert render(shot_path, "-o", tmp_path / "out", "--frames", "1", "--json") == 0
    out, err = capsys.readouterr()
    told, result = events(out)
    assert [event["message"].partition("(")[0] for event in told if event["event"] == "warning"] == [
        f"image '{name}' cannot be read " for name in ("empty", "gone")
    ]
    assert err.count("warning: image") == 2
    assert result["written"] == 1


def test_frames_of_another_process_are_left_to_it(shot_path, tmp_path, fake_session, capsys):
    (tmp_path / "out").mkdir()
    claim = tmp_path / "out" / ".wave_0002.claim"
    claim.write_text(json.dumps({"place": "another machine", "pid": 1}))
    capsys.readouterr()
    assert render(shot_path, "-o", tmp_path / "out") == 0
    *_, told, summary = capsys.readouterr().out.splitlines()
    assert told == "frame 2 (2/3): left to another process"
    assert "3 frames (2 written, 0 already there, 1 left to other processes)" in summary
    assert claim.exists()
    assert not (tmp_path / "out" / "wave_0002.exr").exists()


def test_what_kills_left_is_removed_and_what_lives_is_not(shot_path, tmp_path, fake_session):
    (tmp_path / "out").mkdir()
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    dead = ["wave_0009.claim", "wave_0009.0123abcd.part.exr", "wave_-004.claim.2", "wave_0002.part.exr"]
    alive = ["wave_0010.claim", "wave_0010.0123abcd.part.exr", "other_0001.claim", "wave_b_0001.part.exr"]
    for name in (*dead, *alive):
        pid = process.pid if name in dead else os.getppid()
        (tmp_path / "out" / f".{name}").write_text(json.dumps({"place": process_space(), "pid": pid}))
    assert render(shot_path, "-o", tmp_path / "out", "--frames", "1") == 0
    assert sorted(hidden(tmp_path / "out")) == sorted(f".{name}" for name in alive)


def test_a_frame_that_is_taken_over_meanwhile_is_dropped(shot_path, tmp_path, fake_session, capsys, monkeypatch):
    monkeypatch.setattr("livehand.backend.batch.leases.Claims.holds", lambda self, claim: claim.frame != 2)
    assert render(shot_path, "-o", tmp_path / "out") == 0
    assert "1 left to other processes" in capsys.readouterr().out
    assert len(list((tmp_path / "out").glob("*.exr"))) == 2
    assert hidden(tmp_path / "out") == []


def test_workers_write_each_frame_once_overwrite_it_once_and_fail_once(program, tmp_path):
    folder, missing = tmp_path / "out" / "wave", tmp_path / "no.blend"
    arguments = (missing, "--frames", "1-8", "--jobs", "2", "--json")
    changed = {}
    for more in ((), ("--overwrite",)):
        process = program(*arguments, *more, seconds=0.1)
        out, err = process.communicate(timeout=60)
        told, result = events(out)
        assert process.returncode == 1
        assert err.count("\n") == err.count(f"livehand render: {missing}: no file at") == 1
        rows = [(file["written"], file["skipped"], file["left"]) for file in result["files"]]
        assert rows == [(8, 0, 0), (0, 0, 0)]
        assert sorted(event["frame"] for event in told if event["event"] == "frame") == list(range(1, 9))
        assert [event["event"] for event in told].count("shot") == 1
        assert hidden(folder) == []
        files = {path: path.stat().st_mtime_ns for path in folder.glob("*.exr")}
        assert all(is_finished(path, SIZE_PX) for path in files)
        assert all(files[path] > time_ns for path, time_ns in changed.items())
        changed = files
    assert len(changed) == 8


def wait_for_frames(folder, count):
    end = time.monotonic() + 30
    while len(list(folder.glob("*.exr"))) < count:
        assert time.monotonic() < end, f"no {count} frames in 30 s"
        time.sleep(0.02)


def children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers in /proc")
def test_a_killed_workers_frames_are_taken_over(program, tmp_path):
    process = program("--frames", "1-16", "--jobs", "2", "--json", seconds=0.1)
    wait_for_frames(tmp_path / "out", 3)
    victim = json.loads(next((tmp_path / "out").glob(".*.claim")).read_text())["pid"]
    assert victim in children(process.pid)
    os.kill(victim, signal.SIGKILL)
    out, _ = process.communicate(timeout=60)
    _, result = events(out)
    assert process.returncode == 0
    assert result["written"] + result["skipped"] == result["frames"] == 16
    assert hidden(tmp_path / "out") == []


@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers in /proc")
def test_frames_that_no_worker_is_left_to_render_are_a_failure(program, tmp_path):
    process = program("--frames", "1-200", "--jobs", "2", "--json", seconds=0.1)
    wait_for_frames(tmp_path / "out", 2)
    for worker in children(process.pid):
        os.kill(worker, signal.SIGKILL)
    out, err = process.communicate(timeout=60)
    _, result = events(out)
    assert process.returncode == 1
    assert re.search(r"\d+ of 200 frames are missing: a worker process failed \(signal 9\); run the same", err)
    assert result["files"][0]["error"] in err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_workers_end_with_their_parent(program, tmp_path, number, code):
    process = program("--frames", "1-200", "--jobs", "2", seconds=0.1)
    wait_for_frames(tmp_path / "out", 3)
    process.send_signal(number)
    # The pipes end with the last worker.
    _, err = process.communicate(timeout=30)
    assert process.returncode == code
    assert err == ("livehand render: interrupted\n" if code == 130 else "")
    assert hidden(tmp_path / "out") == []
    assert len(list((tmp_path / "out").glob("*.exr"))) < 200


def test_killed_three_times_it_is_whole_in_the_end(shot_path, tmp_path):
    kill_test = runpy.run_path(str(KILL_TEST))
    report = kill_test["survive_kills"](
        [sys.executable, str(FAKE_PROGRAM), "render", str(shot_path), "--frames", "1-12", "--size", "48x64"],
        tmp_path / "kills",
        kills=3,
        delay_s=(0.0, 0.05),
        random=random.Random(0),
    )
    assert report["frames"] == report["equal"] == 12
    assert report["most_frames_lost_per_kill"] <= 2  # the one being written, and the one ahead of it
    assert report["written_twice"] == 0
    assert report["leftovers"] == []


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a disk of 64 kB of its own."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)], check=False, capture_output=True
    )
    if mounted.returncode:
        pytest.skip("no disk can be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_told_breaks_no_file_and_is_resumed_after(shot_path, small_disk, fake_session, capsys):
    arguments = (shot_path, "-o", small_disk, "--size", "96x128", "--frames", "1-8")
    assert render(*arguments) == 1
    err = capsys.readouterr().err
    assert "could not be written" in err
    assert "disk full" in err or "make room" in err
    whole = list(small_disk.glob("*.exr"))
    assert 1 <= len(whole) < 8
    assert all(is_finished(path, (96, 128)) for path in whole)
    assert hidden(small_disk) == []
    subprocess.run(["mount", "-o", "remount,size=1m", str(small_disk)], check=True)
    assert render(*arguments, "--json") == 0
    _, result = events(capsys.readouterr().out)
    assert (result["written"], result["skipped"]) == (8 - len(whole), len(whole))
