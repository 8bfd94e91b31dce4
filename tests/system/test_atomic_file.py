"""A file is whole or as before, and nobody else's file is touched on the way."""

import os
import signal
import subprocess
import sys
import time

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import files as atomic_file
from livehand.backend.system.files import rename_over, replacing
from livehand.backend.system.processes import process_name


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("is_durable", [False, True])
def test_the_file_takes_its_place_at_the_end(tmp_path, is_durable):
    path = tmp_path / "new" / "a.json"
    with replacing(path, is_durable) as temporary:
        temporary.write_text("whole")
        assert (temporary.parent, temporary.suffix) == (path.parent, ".json")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert names(path.parent) == ["a.json"]


def test_it_has_the_rights_of_any_new_file(tmp_path):
    (tmp_path / "other").touch()
    with replacing(tmp_path / "a"):
        pass
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "other").stat().st_mode


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, LiveHandError])
def test_a_failure_leaves_what_was_there(tmp_path, error):
    (tmp_path / "a.txt").write_text("before")

    def fail():
        with replacing(tmp_path / "a.txt") as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert names(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "before"


def test_a_full_disk_names_the_file(tmp_path):
    with pytest.raises(LiveHandError, match=r"a\.txt must be writable \(.*No space"), replacing(tmp_path / "a.txt"):
        raise OSError(28, "No space left on device")
    assert names(tmp_path) == []


def test_a_folder_in_the_way_names_the_file(tmp_path):
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "a.txt", tmp_path):
        with pytest.raises(LiveHandError, match="must be writable"), replacing(path) as temporary:
            temporary.write_text("x")


def test_temporary_names_differ_and_an_existing_file_or_link_is_never_taken(tmp_path, monkeypatch):
    with replacing(tmp_path / "a") as one, replacing(tmp_path / "a") as other:
        assert one != other
    (tmp_path / "theirs").write_text("theirs")
    monkeypatch.setattr(atomic_file.secrets, "token_hex", lambda _: "guessed")
    guessed = tmp_path / f".a.guessed-{process_name()}.partial"
    guessed.symlink_to(tmp_path / "theirs")
    with pytest.raises(LiveHandError, match="exists"), replacing(tmp_path / "a") as temporary:
        temporary.write_text("ours")
    assert (tmp_path / "theirs").read_text() == "theirs"
    assert guessed.is_symlink()


KILLED = """
import os, signal, sys
from pathlib import Path
from livehand.backend.system.files import replacing
with replacing(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_what_a_killed_process_leaves_is_removed_by_the_next_one_and_nothing_else_is(tmp_path):
    assert subprocess.run([sys.executable, "-c", KILLED, tmp_path / "a.png"], check=False).returncode < 0
    (left,) = names(tmp_path)
    token, day_ago = "0123456789abcdef", time.time() - 25 * 3600
    space, _, dead = left.split("-", 1)[1].split(".")[0].partition("-")
    old = [f".b.{token}.partial.png", f".b.{token}-00000000-1.partial"]
    theirs = [
        *(
            f".c.{token}.partial.png",
            f".c.{token}-{space}-{os.getppid()}.partial.png",
            f".c.{token}-00000000-1.partial",
        ),
        *(f"c.{token}-{space}-{dead}.partial.png", f".c.{token}-{space}-{dead}.png", "x.partial", ".x.partial.png"),
        f".c.{token}-{space}-.partial.png",
    ]
    for name in (*old, *theirs):
        (tmp_path / name).touch()
    for name in (*old, "x.partial", ".x.partial.png"):
        os.utime(tmp_path / name, (day_ago, day_ago))
    with replacing(tmp_path / "a.png"):
        pass
    assert names(tmp_path) == sorted([*theirs, "a.png"])


def test_a_long_name_has_a_shorter_temporary_one(tmp_path):
    path = tmp_path / ("é" * 120 + ".txt")
    with replacing(path) as temporary:
        temporary.write_text("x")
    assert path.read_text() == "x"


def test_windows_is_asked_again_while_another_process_reads_the_file(tmp_path, monkeypatch):
    source, target, calls = tmp_path / "a", tmp_path / "b", []
    source.write_text("new")
    replace = os.replace

    def refuse_twice(*paths):
        calls.append(paths)
        if len(calls) < 3:
            raise PermissionError(13, "in use")
        replace(*paths)

    monkeypatch.setattr(atomic_file.os, "replace", refuse_twice)
    monkeypatch.setattr(atomic_file, "_RETRY_S", 0.0)
    with pytest.raises(PermissionError):
        rename_over(source, target)
    monkeypatch.setattr(atomic_file.os, "name", "nt")
    rename_over(source, target)
    monkeypatch.undo()
    assert (target.read_text(), len(calls)) == ("new", 3)
