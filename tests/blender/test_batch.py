"""Several shots, chunks, worker processes, kills and full disks, through the `livehand` program."""

import json
import os
import random
import re
import runpy
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import bpy
import pytest
from livehand.backend.batch import leases
from livehand.backend.batch.frame_file import is_finished
from livehand.backend.batch.frame_paths import FrameParts, FramePaths
from livehand.backend.batch.leases import FrameLeases
from livehand.backend.system.processes import process_space
from livehand.livehand_blender import cli

FAKE_PROGRAM = Path(__file__).parent / "fake_livehand.py"
KILL_TEST = Path(__file__).parents[2] / "examples" / "kill_test.py"
SIZE_PX = (48, 64)


@pytest.fixture
def program(shot_path, tmp_path):
    """A function: start `livehand render` into `out`, with further arguments."""
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
    *lines, result = map(json.loads, out.splitlines())
    return lines, result


def test_each_of_several_shots_has_a_folder_and_a_failing_one_does_not_stop_the_others(
    shot_path, tmp_path, fake_session, capsys
):
    other, bad = tmp_path / "other.blend", tmp_path / "bad.blend"
    shutil.copy(shot_path, other)
    bad.write_text("no blend")
    capsys.readouterr()
    assert render(bad, shot_path, other, "-o", tmp_path / "out", "--frames", "1-2", "--json") == 1
    out, err = capsys.readouterr()
    seen, result = events(out)
    assert [event["event"] for event in seen] == ["error", "shot", "frame", "frame", "shot", "frame", "frame"]
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


def test_the_summary_names_the_failed_shots(shot_path, tmp_path, fake_session, capsys):
    missing = tmp_path / "no.blend"
    capsys.readouterr()
    assert render(missing, shot_path, "-o", tmp_path / "out", "--frames", "2") == 1
    out, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert out.splitlines()[0].startswith("wave frame 2 (1/1): ")
    assert out.splitlines()[-1] == f"failed: {missing}"


def test_two_shots_of_one_name_are_an_error_before_anything_is_rendered(tmp_path, capsys):
    assert render("a/wave.blend", "b/Wave.blend", "-o", tmp_path / "out") == 1
    assert "must differ in name" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("chunk", ["", "1", "0/2", "3/2", "1/0", "-1/2", "1/2/3", "a/b"])
def test_a_bad_chunk_is_a_usage_error(capsys, chunk):
    assert render("x.blend", "-o", "out", f"--chunk={chunk}") == 2
    assert "--chunk" in capsys.readouterr().err


def test_a_chunk_renders_its_part_of_the_shots_range(shot_path, tmp_path, fake_session):
    assert render(shot_path, "-o", tmp_path / "out", "--chunk", "2/2") == 0
    assert sorted(path.name for path in (tmp_path / "out").glob("*.exr")) == ["wave_0002.exr", "wave_0003.exr"]


def test_an_unreadable_texture_is_a_warning_and_rendering_continues(
    hand_scene, shot_path, tmp_path, fake_session, capsys
):
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
    seen, result = events(out)
    assert [event["message"].partition("(")[0] for event in seen if event["event"] == "warning"] == [
        f"image '{name}' cannot be read " for name in ("empty", "gone")
    ]
    assert err.count("warning: image") == 2
    assert result["written"] == 1


ELSEWHERE = json.dumps({"place": "another machine", "pid": 1})


def test_a_run_renders_the_frames_of_a_worker_that_died_elsewhere(
    shot_path, tmp_path, fake_session, capsys, monkeypatch
):
    """A farm's task that says done is done: nobody else will render what the dead worker had leased."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".wave_0002.claim").write_text(ELSEWHERE)
    monkeypatch.setattr(leases, "STALE_S", 3.0)
    capsys.readouterr()
    assert render(shot_path, "-o", tmp_path / "out") == 0
    *_, waiting, progress, summary = capsys.readouterr().out.splitlines()
    assert waiting == "frame 2 (2/3): waiting for another process"
    assert re.fullmatch(r"frame 2 \(2/3\): [0-9.]+ s", progress)
    assert "3 frames (3 written, 0 already there)" in summary
    assert len(list((tmp_path / "out").glob("*.exr"))) == 3
    assert hidden(tmp_path / "out") == []


def test_a_run_ends_after_the_live_process_that_renders_its_last_frame(shot_path, tmp_path, fake_session, capsys):
    lease, last = tmp_path / "out" / ".wave_0002.claim", tmp_path / "out" / "wave_0002.exr"
    assert render(shot_path, "-o", tmp_path / "out") == 0
    aside = last.rename(tmp_path / "aside.exr")
    lease.write_text(ELSEWHERE)
    ends = threading.Timer(1.5, lambda: (aside.rename(last), lease.unlink()))
    ends.start()
    capsys.readouterr()
    assert render(shot_path, "-o", tmp_path / "out") == 0
    assert not ends.is_alive()
    assert capsys.readouterr().out.splitlines()[-3:-1] == [
        "frame 2 (2/3): waiting for another process",
        "frame 2 (2/3): already there",
    ]


def test_a_run_that_waits_stops_when_it_is_asked_to(program, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".wave_0002.claim").write_text(ELSEWHERE)
    process = program()
    for line in process.stdout:
        if "waiting" in line:
            break
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=10) == 130
    assert hidden(tmp_path / "out") == [".wave_0002.claim"]


def test_leftovers_of_dead_processes_are_removed_and_those_of_live_ones_are_not(
    shot_path, tmp_path, fake_session, dead_pid
):
    (tmp_path / "out").mkdir()
    dead = ["wave_0009.claim", "wave_0009.0123abcd.part.exr", "wave_-004.claim.2", "wave_0002.part.exr"]
    alive = ["wave_0010.claim", "wave_0010.0123abcd.part.exr", "other_0001.claim", "wave_b_0001.part.exr"]
    for name in (*dead, *alive):
        pid = dead_pid if name in dead else os.getppid()
        (tmp_path / "out" / f".{name}").write_text(json.dumps({"place": process_space(), "pid": pid}))
    assert render(shot_path, "-o", tmp_path / "out", "--frames", "1") == 0
    assert sorted(hidden(tmp_path / "out")) == sorted(f".{name}" for name in alive)


def test_the_lease_of_a_worker_that_dies_once_its_frame_is_finished_is_removed(
    shot_path, tmp_path, fake_session, dead_pid, monkeypatch
):
    def holds(self, lease):
        if lease.frame == 2:
            owner = {"place": process_space(), "pid": dead_pid}
            (tmp_path / "out" / ".wave_0001.claim").write_text(json.dumps(owner))
        return True

    monkeypatch.setattr(FrameLeases, "holds", holds)
    assert render(shot_path, "-o", tmp_path / "out") == 0
    assert len(list((tmp_path / "out").glob("*.exr"))) == 3
    assert hidden(tmp_path / "out") == []


def test_a_frame_whose_lease_is_superseded_meanwhile_is_dropped_and_looked_at_again(
    shot_path, tmp_path, fake_session, capsys, monkeypatch
):
    asked = []

    def holds(self, lease):
        asked.append(lease.frame)
        return asked != [1, 2]

    monkeypatch.setattr(FrameLeases, "holds", holds)
    assert render(shot_path, "-o", tmp_path / "out") == 0
    assert asked == [1, 2, 3, 2]
    assert "3 frames (3 written, 0 already there)" in capsys.readouterr().out
    assert len(list((tmp_path / "out").glob("*.exr"))) == 3
    assert hidden(tmp_path / "out") == []


def test_a_worker_that_slept_while_its_frame_was_taken_over_goes_on(
    shot_path, tmp_path, fake_session, dead_pid, monkeypatch, capsys
):
    """It finds its temporary files gone, which is no full disk; the other one has died since."""
    check, taken = FrameParts.check, []

    def sleep_and_check(self, part, size_px):
        if "wave_0002" in part.name and not taken:
            taken.append(part)
            owner = {"place": process_space(), "pid": dead_pid}
            (tmp_path / "out" / ".wave_0002.claim.1").write_text(json.dumps(owner))
            FramePaths(tmp_path / "out", "wave", 2).remove_parts()
        check(self, part, size_px)

    monkeypatch.setattr(FrameParts, "check", sleep_and_check)
    assert render(shot_path, "-o", tmp_path / "out") == 0
    out, err = capsys.readouterr()
    assert (err, len(taken)) == ("", 1)
    assert "3 frames (3 written, 0 already there)" in out
    assert hidden(tmp_path / "out") == []


def test_workers_write_and_overwrite_each_frame_once_and_report_a_failure_once(program, tmp_path):
    folder, missing = tmp_path / "out" / "wave", tmp_path / "no.blend"
    arguments = (missing, "--frames", "1-8", "--jobs", "2", "--json")
    changed = {}
    for more in ((), ("--overwrite",)):
        process = program(*arguments, *more, seconds=0.1)
        out, err = process.communicate(timeout=60)
        seen, result = events(out)
        assert process.returncode == 1
        assert err.count("\n") == err.count(f"livehand render: {missing}: no file at") == 1
        rows = [(file["written"], file["skipped"], file["left"]) for file in result["files"]]
        assert rows == [(8, 0, 0), (0, 0, 0)]
        assert sorted(event["frame"] for event in seen if event["event"] == "frame") == list(range(1, 9))
        assert [event["event"] for event in seen].count("shot") == 1
        assert hidden(folder) == []
        files = {path: path.stat().st_mtime_ns for path in folder.glob("*.exr")}
        assert all(is_finished(path, SIZE_PX) for path in files)
        assert all(files[path] > time_ns for path, time_ns in changed.items())
        changed = files
    assert len(changed) == 8


def wait_for_frames(folder, count):
    end = time.monotonic() + 90
    while len(list(folder.glob("*.exr"))) < count:
        assert time.monotonic() < end, f"no {count} frames in 90 s"
        time.sleep(0.02)


def children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers in /proc")
def test_the_frames_of_a_killed_worker_are_rendered_by_another(program, tmp_path):
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
def test_frames_are_missing_if_all_workers_are_killed(program, tmp_path):
    process = program("--frames", "1-200", "--jobs", "2", "--json", seconds=0.1)
    wait_for_frames(tmp_path / "out", 2)
    for worker in children(process.pid):
        os.kill(worker, signal.SIGKILL)
    out, err = process.communicate(timeout=60)
    _, result = events(out)
    assert process.returncode == 1
    assert re.search(r"\d+ of 200 frames are missing: a worker process failed \(signal 9\); run the same", err)
    assert result["files"][0]["error"] in err


def test_a_shot_with_drivers_that_python_evaluates_ends_with_its_last_line(hand_scene, shot_path, program, tmp_path):
    """Blender as a module would wait for ever at the end of the interpreter."""
    driver = hand_scene.camera.driver_add("location", 0).driver
    driver.expression = "[1, 2, 3][0] * 0.0 + max(0, 0) - 0.08"
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_empty=True)  # else these tests would not end either
    process = program("--jobs", "2", "--json")
    wait_for_frames(tmp_path / "out", 3)
    out, err = process.communicate(timeout=5)
    assert process.returncode == 0, err
    assert events(out)[1]["written"] == 3


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, 130),
        (signal.SIGKILL, -9),
        pytest.param(signal.SIGTERM, 130, marks=pytest.mark.nightly),
        pytest.param(signal.SIGHUP, 130, marks=pytest.mark.nightly),
    ],
)
def test_workers_end_with_their_parent(program, tmp_path, number, code):
    process = program("--frames", "1-200", "--jobs", "2", seconds=0.1)
    wait_for_frames(tmp_path / "out", 3)
    workers = children(process.pid)
    process.send_signal(number)
    assert process.wait(timeout=30) == code
    if code == 130:
        assert [worker for worker in workers if Path(f"/proc/{worker}").exists()] == []
    # The pipes end with the last worker.
    _, err = process.communicate(timeout=30)
    assert err == ("livehand render: interrupted\n" if code == 130 else "")
    assert hidden(tmp_path / "out") == []
    assert len(list((tmp_path / "out").glob("*.exr"))) < 200


def test_a_run_killed_three_times_is_complete_in_the_end(shot_path, tmp_path):
    kill_test = runpy.run_path(str(KILL_TEST))
    report = kill_test["survive_kills"](
        [sys.executable, str(FAKE_PROGRAM), "render", str(shot_path), "--frames", "1-12", "--size", "48x64"],
        tmp_path / "kills",
        kills=3,
        delay_s=(0.0, 0.05),
        random=random.Random(0),
    )
    assert report["frames"] == report["equal"] == 12
    assert report["most_frames_lost_per_kill"] <= 2  # the one being written, and the prefetched one
    assert report["written_twice"] == 0
    assert report["leftovers"] == []


@pytest.mark.parametrize(("deletes_in", "gone"), [((1, 2, 3), "the lease of frame 1 is gone"), ((2,), "1 of 3 frames")])
def test_an_output_folder_that_is_deleted_meanwhile_is_an_error(
    shot_path, tmp_path, fake_session, monkeypatch, capsys, deletes_in, gone
):
    """A frame that is still rendered is rendered again, but what was reported as written is lost."""
    begun = []

    def holds(self, lease):
        begun.append(lease.frame)
        if lease.frame in deletes_in and (deletes_in != (2,) or begun.count(2) == 1):
            shutil.rmtree(tmp_path / "out")
            (tmp_path / "out").mkdir()
        return lease.path.exists()

    monkeypatch.setattr(FrameLeases, "holds", holds)
    assert render(shot_path, "-o", tmp_path / "out") == 1
    err = capsys.readouterr().err
    assert f"the output folder {tmp_path / 'out'} must stay while frames are rendered, {gone}" in err


@pytest.mark.skipif(os.name == "nt", reason="there, two slashes begin a share's name")
def test_an_output_folder_with_two_slashes_is_no_folder_of_the_blend(shot_path, tmp_path, fake_session, capsys):
    assert render(shot_path, "-o", f"/{tmp_path}/out", "--format", "exr,png", "--frames", "1") == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        f"wave_0001.{suffix}" for suffix in ("exr", "json", "png")
    ]


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


def test_a_full_disk_is_an_error_leaves_no_broken_file_and_is_resumed(shot_path, small_disk, fake_session, capsys):
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
