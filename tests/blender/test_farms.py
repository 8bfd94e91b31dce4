"""The farm examples: their commands are ours, and Open Job Description's own runner runs them."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import pytest
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
    assert [command["parameters"]["args"][-2] for command in commands] == [f"--chunk={n}/3" for n in (1, 2, 3)]
    # Our own parser takes it, and misses the shot only.
    assert cli.main([*commands[0]["parameters"]["args"], "-o", str(tmp_path / "out")]) == 1
    assert "no file at" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("openjd") is None, reason="openjd-cli is not installed")
def test_open_job_description_renders_every_chunk(hand_scene, tmp_path):
    shot, out, program = tmp_path / "wave.blend", tmp_path / "out", tmp_path / "livehand"
    bpy.ops.wm.save_as_mainfile(filepath=str(shot))
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {FAKE_PROGRAM} "$@"\n')
    program.chmod(0o755)
    parameters = {"Shot": shot, "Output": out, "Frames": "1-5", "ChunkCount": 2, "LiveHand": program}
    job = [part for name, value in parameters.items() for part in ("--job-param", f"{name}={value}")]
    workers = [
        subprocess.Popen(
            ["openjd", "run", str(FARM / "livehand.openjd.yaml"), *job, "--task-param", f"Chunk={chunk}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for chunk in (1, 2)
    ]
    outputs = [worker.communicate(timeout=60)[0] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], outputs
    assert sorted(path.name for path in out.glob("*.exr")) == [f"wave_000{n}.exr" for n in range(1, 6)]
    assert ['"written": 2' in outputs[0], '"written": 3' in outputs[1]] == [True, True]
