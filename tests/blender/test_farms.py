"""The farm examples: their commands are ours, and Open Job Description's own runner runs them."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest
from livehand.backend.batch.frame_file import is_finished
from livehand.livehand_blender import cli

FARM = Path(__file__).parents[2] / "examples" / "farm"
FAKE_PROGRAM = Path(__file__).parent / "fake_livehand.py"

# What Flamenco's Manager gives a job type, as far as ours needs it.
COMPILE = """
const author = {
    Task: (name, type) => ({ name, type, commands: [], addCommand(command) { this.commands.push(command) } }),
    Command: (name, parameters) => ({ name, parameters }),
}
const job = { settings: JSON.parse(process.argv[2]), tasks: [], addTask(task) { this.tasks.push(task) } }
compileJob(job)
console.log(JSON.stringify({ settings: JOB_TYPE.settings, tasks: job.tasks }))
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_flamenco_makes_a_task_of_every_chunk(tmp_path, capsys):
    script = tmp_path / "compile.js"
    script.write_text((FARM / "livehand.flamenco.js").read_text() + COMPILE)
    settings = {
        "frames": "1-24",
        "chunk_count": 3,
        "output": "out",
        "format": "exr,png",
        "livehand": "livehand",
        "blendfile": str(tmp_path / "no.blend"),
    }
    done = subprocess.run(
        ["node", str(script), json.dumps(settings)], capture_output=True, text=True, check=True, timeout=20
    )
    compiled = json.loads(done.stdout)
    assert {setting["key"] for setting in compiled["settings"]} == settings.keys()
    commands = [command for task in compiled["tasks"] for command in task["commands"]]
    assert [command["name"] for command in commands] == ["exec"] * 3
    assert [command["parameters"]["args"][-3] for command in commands] == [f"--chunk={n}/3" for n in (1, 2, 3)]
    # Our own parser takes it, and misses the shot only.
    assert cli.main([*commands[0]["parameters"]["args"], "-o", str(tmp_path / "out")]) == 1
    assert "no file at" in capsys.readouterr().err


@pytest.fixture
def openjd(hand_scene, tmp_path):
    """A function (the job's parameters, more arguments): start the template with its own runner."""
    if shutil.which("openjd") is None:
        pytest.skip("openjd-cli (the extra farm) is not installed")
    shot, program = tmp_path / "wave.blend", tmp_path / "livehand"
    bpy.ops.wm.save_as_mainfile(filepath=str(shot))
    program.write_text(f'#!/bin/sh\nFAKE_SECONDS=0.2 exec {sys.executable} {FAKE_PROGRAM} "$@"\n')
    program.chmod(0o755)
    started = []

    def start(parameters, *more):
        given = {"Shot": shot, "Output": tmp_path / "out", "LiveHand": program, **parameters}
        job = [part for name, value in given.items() for part in ("--job-param", f"{name}={value}")]
        command = ["openjd", "run", str(FARM / "livehand.openjd.yaml"), *job, *more]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def frames_of(out):
    return sorted(path.name for path in out.glob("*.exr"))


def test_open_job_description_renders_every_chunk(openjd, tmp_path):
    job = {"Frames": "1-5", "ChunkCount": 2}
    workers = [openjd(job, "--task-param", f"Chunk={chunk}") for chunk in (1, 2)]
    outputs = [worker.communicate(timeout=120)[0] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], outputs
    assert frames_of(tmp_path / "out") == [f"wave_000{n}.exr" for n in range(1, 6)]
    assert ['"written": 2' in outputs[0], '"written": 3' in outputs[1]] == [True, True]


def test_a_task_that_open_job_description_cancels_leaves_whole_frames_and_is_resumed(openjd, tmp_path):
    out = tmp_path / "out"
    job = {"Frames": "1-12", "ChunkCount": 1}
    worker = openjd(job)
    end = time.monotonic() + 120
    while len(frames_of(out)) < 2 and worker.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.05)
    worker.send_signal(signal.SIGINT)
    printed = worker.communicate(timeout=60)[0]
    assert worker.returncode != 0, printed
    kept = frames_of(out)
    assert 2 <= len(kept) < 12
    assert all(is_finished(out / name, (48, 64)) for name in kept)
    assert [path.name for path in out.iterdir() if path.name.startswith(".")] == []
    again = openjd(job)
    printed = again.communicate(timeout=120)[0]
    assert again.returncode == 0, printed
    assert len(frames_of(out)) == 12
    assert f'"skipped": {len(kept)}' in printed


def test_a_task_beside_frames_of_another_shot_fails(openjd, tmp_path):
    """Its clip would be of two versions."""
    first = openjd({"Frames": "1", "ChunkCount": 1})
    assert first.wait(120) == 0
    bpy.context.scene.camera.location.x -= 0.01
    bpy.ops.wm.save_mainfile()
    second = openjd({"Frames": "1-2", "ChunkCount": 1})
    printed = second.communicate(timeout=120)[0]
    assert second.returncode != 0
    assert "1 frame is of another state of the .blend" in printed
    assert frames_of(tmp_path / "out") == ["wave_0001.exr"]
