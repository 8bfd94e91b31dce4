"""Jobs in processes of their own: results, errors, progress, cancellation, and the package's name there."""

import json
import os
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


def wait_until(holds):
    end = time.monotonic() + 20
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


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
    wait_until(lambda: job.progress.text == "1")
    assert job.is_running
    job.cancel()
    wait_until(lambda: not job.is_running)
    with pytest.raises(LiveHandError):
        job.result()


WORK = """
import time
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.child_job import JobProgress, run_job
def work(request, report):
    report(JobProgress("1 of 2", 0.5))
    {then}
    return {{"request": request}}
run_job(work, "too many hands; choose fewer")
"""


def working(then):
    """The process of a job that reports its progress, then does something."""
    command = [sys.executable, "-c", WORK.format(then=then), "", json.dumps([1, "ü"])]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}  # which jobs ignore
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env)


@pytest.mark.parametrize(
    ("then", "written"),
    [
        ("pass", {"request": [1, "ü"]}),
        ("raise LiveHandError('a film must show a hand')", {"error": "a film must show a hand"}),
        ("raise MemoryError", {"error": "too many hands; choose fewer"}),
    ],
)
def test_the_process_writes_progress_then_its_result_or_error(then, written):
    with working(then) as process:
        lines = process.stdout.readlines()
    assert [json.loads(line) for line in lines] == [{"progress": "1 of 2", "share": 0.5}, written]


def test_progress_is_written_at_once_and_the_work_ends_with_its_parent():
    process = working("time.sleep(600)")
    job = ChildJob("working", process)
    try:
        wait_until(lambda: job.progress == JobProgress("1 of 2", 0.5))
        process.stdin.close()
        assert process.wait(20) == 1
    finally:
        process.kill()


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
