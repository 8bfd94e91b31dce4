"""`make demo` on machines with other versions of Python, simulated by a PATH of its own; nothing is installed."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TOOLS = ("sh", "make", "sed", "date", "touch")


@pytest.fixture
def make(tmp_path):
    """A function (Python programs, arguments) -> a finished `make` on a Linux that has those programs alone."""
    if os.name != "posix" or any(shutil.which(tool) is None for tool in TOOLS):
        pytest.skip("needs make and a POSIX shell")
    for name in ("Makefile", "pyproject.toml", "setup.py", "blender_manifest.toml"):
        shutil.copy(ROOT / name, tmp_path)
    programs = tmp_path / "bin"
    programs.mkdir()
    for tool in TOOLS:
        (programs / tool).symlink_to(shutil.which(tool))

    def add(name, line):
        (programs / name).write_text(f"#!/bin/sh\n{line}\n")
        (programs / name).chmod(0o755)

    def run(pythons, *arguments):
        add("uname", "echo Linux")
        for name in pythons:
            add(name, "exit 0")
        command = ["make", *arguments]
        return subprocess.run(command, cwd=tmp_path, env={"PATH": str(programs)}, capture_output=True, text=True)

    return run


@pytest.mark.parametrize("pythons", [(), ("python3.12",)])
def test_without_a_python_that_will_do_one_line_says_what_to_install(make, pythons):
    done = make(pythons, "demo")
    assert done.returncode != 0
    first, *others = done.stderr.splitlines()
    assert "Install python3.11" in first
    assert "3.13" in first
    assert all(line.startswith("make: ***") for line in others)


@pytest.mark.parametrize(
    ("pythons", "chosen"), [(("python3.12", "python3.13"), "python3.13"), (("python3.11", "python3.13"), "python3.11")]
)
def test_the_python_that_blender_has_a_module_for_is_chosen(make, pythons, chosen):
    assert f"{chosen} -m venv .venv" in make(pythons, "--dry-run", "demo").stdout


def test_without_a_gpu_torch_is_for_cpus_from_the_index_that_is_named_and_make_says_so(make):
    default, named, gpu = (
        make(("python3.11",), "--dry-run", "demo", *more).stdout
        for more in ([], ["CPU_TORCH=somewhere"], ["TORCH=gpu", "CPU_TORCH=somewhere"])
    )
    assert "No NVIDIA GPU found: make CPU_TORCH=ADDRESS" in default
    assert "--index-url somewhere" in named
    assert "torch>=2.6" in named
    assert "--index-url" not in default + gpu


def test_the_fast_tests_leave_out_folders_that_are_there(make):
    (command,) = (line for line in joined(make(("python3.11",), "--dry-run", "test-fast").stdout) if "pytest" in line)
    left_out = [word.removeprefix("--ignore=") for word in command.split() if word.startswith("--ignore=")]
    assert left_out
    assert [name for name in left_out if not (ROOT / name).is_dir()] == []


def joined(text):
    """The commands of a dry run, each in one line."""
    return text.replace("\\\n", " ").splitlines()


def test_a_release_is_built_with_the_index_and_the_site_that_are_named_and_needs_no_torch(make):
    done = make(
        ("python3.11",), "--dry-run", "release", "CPU_TORCH=somewhere", "WEBSITE=site", "ZIPS_URL=z", "PAGE_URL=p"
    )
    text = " ".join(joined(done.stdout))
    assert "livehand.tools.release.build --out dist/release --website site --cpu-torch somewhere" in text
    assert "--zips-url z --page-url p" in text
    assert "livehand.tools.release.try_zip" in text
    assert "pip install --disable-pip-version-check --quiet --no-deps -e ." in text
    assert "[bpy]" not in text
    slim = make(("python3.11",), "--dry-run", "zip").stdout
    assert slim.split()[-4:] == ["livehand.tools.release.build", "--out", "dist", "--only"]
