"""Jobs in processes of their own: results, errors, progress, cancellation, and the package's name there."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import child_job
from livehand.backend.system.child_job import ChildJob, JobProgress

LINES = """
import sys, time
print("not a message")
for line in {lines}:
    print(line, flush=True)
if {waits}:
    sys.stdin.read(1)  # until the parent ends, as jobs do
sys.exit({code})
"""


def job_that_says(*lines, code=0, waits=False):
    program = LINES.format(lines=list(lines), code=code, waits=waits)
    process = subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    return ChildJob("counting", process)


def test_a_result_is_what_is_neither_progress_nor_noise():
    job = job_that_says('{"progress": "1 of 2", "share": 0.5}', '{"hands": ["right"]}', "7")
    assert job.progress in (JobProgress("starting"), JobProgress("1 of 2", 0.5))
    job.wait()
    assert not job.is_running
    assert job.progress == JobProgress("1 of 2", 0.5)
    assert job.result() == {"hands": ["right"]}


@pytest.mark.parametrize(
    ("lines", "message"),
    [(['{"error": "a film must show a hand"}'], "a film must show a hand"), ([], "counting ended unexpectedly")],
)
def test_an_error_and_a_death_are_errors(lines, message):
    job = job_that_says(*lines, code=3)
    job.wait()
    with pytest.raises(LiveHandError, match=message):
        job.result()


def test_a_job_is_canceled_in_the_middle():
    job = job_that_says('{"progress": "1"}', waits=True)
    end = time.monotonic() + 20
    while job.progress.text != "1":
        assert time.monotonic() < end
        time.sleep(0.01)
    assert job.is_running
    job.cancel()
    job.wait()
    with pytest.raises(LiveHandError):
        job.result()


def test_files_of_the_current_folder_are_not_run(monkeypatch, tmp_path):
    """Blender may be started where a project has a json.py of its own."""
    (tmp_path / "backend").mkdir()
    for package in (tmp_path, tmp_path / "backend"):
        (package / "__init__.py").write_text("")
    lines = "import colorsys, json", "def run():", "    print(json.dumps({'black': colorsys.rgb_to_hsv(0, 0, 0)[2]}))"
    (tmp_path / "backend" / "painter.py").write_text("\n".join(lines))
    for shadow in ("json.py", "colorsys.py"):
        (tmp_path / shadow).write_text("raise SystemExit(9)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    monkeypatch.setattr(child_job, "_ROOT", tmp_path)
    job = ChildJob.start("painting", "painter", None)
    job.wait()
    assert job.result() == {"black": 0}


@pytest.mark.parametrize("package", ["livehand", "bl_ext.user_default.livehand"])
def test_the_package_has_its_name_in_the_process(monkeypatch, tmp_path, package):
    """Compiled kernels are kept by it: another name would compile all of them again."""
    (tmp_path / "backend").mkdir()
    (tmp_path / "__init__.py").write_text("")
    (tmp_path / "backend" / "__init__.py").write_text("")
    (tmp_path / "backend" / "named.py").write_text(
        "import json, sys\ndef run():\n    print(json.dumps({'name': __name__, 'request': json.loads(sys.argv[2])}))\n"
    )
    monkeypatch.setattr(child_job, "_PACKAGE", package)
    monkeypatch.setattr(child_job, "_ROOT", tmp_path)
    job = ChildJob.start("naming", "named", [1, "ü"])
    job.wait()
    assert job.result() == {"name": f"{package}.backend.named", "request": [1, "ü"]}


def test_it_starts_this_package():
    assert child_job._PACKAGE == "livehand"
    assert (Path(child_job._ROOT) / "backend" / "system" / "child_job.py").samefile(child_job.__file__)
