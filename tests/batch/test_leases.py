"""Leases on frames: each has one owner, whatever process dies, sleeps or races."""

import json
import os
import threading
import time
from collections import Counter

import pytest
from livehand.backend.batch import leases as leases_module
from livehand.backend.batch.leases import STALE_S, UNSIGNED_S, FrameLeases
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.processes import process_space


@pytest.fixture
def leases(tmp_path):
    with FrameLeases(tmp_path, "wave") as leases:
        yield leases


def names(folder):
    return sorted(os.listdir(folder))


def leave(folder, generation=0, pid=None, place=None, age_s=0.0):
    """Write another process's lease on frame 1."""
    path = folder / (".wave_0001.claim" + (f".{generation}" if generation else ""))
    path.write_text(json.dumps({"place": place or process_space(), "pid": pid or os.getppid()}))
    os.utime(path, (time.time() - age_s,) * 2)
    return path


def test_a_frame_has_one_owner_until_it_is_released(leases, tmp_path):
    lease = leases.acquire(1)
    assert names(tmp_path) == [".wave_0001.claim"]
    owner = json.loads(lease.path.read_text())
    assert owner["pid"] == os.getpid()
    assert set(owner) == {"host", "place", "pid", "time"}
    with FrameLeases(tmp_path, "wave") as other:
        assert other.acquire(1) is None
        assert other.acquire(2) is not None
        assert other.acquire(10001) is not None
    assert names(tmp_path) == [".wave_0001.claim"]  # the other has released its own
    leases.release(lease)
    assert names(tmp_path) == []
    assert leases.acquire(1) is not None


def test_leases_of_other_shots_do_not_count(leases, tmp_path):
    (tmp_path / ".wave_0001.claims").touch()
    (tmp_path / ".wave_0001_0001.claim").write_text("{}")
    assert leases.acquire(1).generation == 0


@pytest.mark.parametrize(
    ("how", "is_live"),
    [
        ({}, True),
        ({"age_s": STALE_S + 5}, False),
        ({"place": "another machine"}, True),
        ({"place": "another machine", "age_s": STALE_S + 5}, False),
        ({"place": "another machine", "pid": "dead"}, True),
        ({"pid": "dead"}, False),
    ],
)
def test_only_dead_leases_are_superseded_and_then_removed(leases, tmp_path, dead_pid, how, is_live):
    leave(tmp_path, **{name: dead_pid if value == "dead" else value for name, value in how.items()})
    lease = leases.acquire(1)
    if is_live:
        assert lease is None
        assert names(tmp_path) == [".wave_0001.claim"]
        return
    assert lease.generation == 1
    assert names(tmp_path) == [".wave_0001.claim", ".wave_0001.claim.1"]
    leases.release(lease)
    assert names(tmp_path) == []


@pytest.mark.parametrize("content", ["owned", "unsigned"])
def test_a_lease_of_the_future_is_dead_when_it_was_seen_unchanged_for_long(leases, tmp_path, monkeypatch, content):
    """As of a machine whose clock was wrong, or a folder whose clock was set back."""
    path = leave(tmp_path, place="another machine", age_s=-1e6)
    if content == "unsigned":
        path.write_text("")
        os.utime(path, (time.time() + 1e6,) * 2)
    patience_s = STALE_S if content == "owned" else UNSIGNED_S
    now_s = [time.monotonic()]
    monkeypatch.setattr(leases_module.time, "monotonic", lambda: now_s[0])
    assert leases.acquire(1) is None
    now_s[0] += 0.9 * patience_s
    assert leases.acquire(1) is None
    os.utime(path, (time.time() + 2e6,) * 2)  # its owner lives
    assert leases.acquire(1) is None
    now_s[0] += 0.9 * patience_s
    assert leases.acquire(1) is None
    now_s[0] += 0.2 * patience_s
    assert leases.acquire(1).generation == 1


def test_an_unsigned_lease_is_dead_after_a_second(leases, tmp_path):
    path = tmp_path / ".wave_0001.claim"
    path.touch()
    assert leases.acquire(1) is None
    os.utime(path, (time.time() - 2 * UNSIGNED_S,) * 2)
    assert leases.acquire(1).generation == 1


ODD = {
    "a number": b"5",
    "a list": b"[]",
    "no owner": b"{}",
    "wrong types": b'{"place": 5, "pid": "1"}',
    "no process": b'{"place": "here", "pid": 0}',
    "not UTF-8": b"\xff\xfe",
    "a huge number": b'{"place": "here", "pid": ' + b"9" * 5000 + b"}",
    "megabytes": b" " * 2_000_000,
}


@pytest.mark.parametrize("content", ODD.values(), ids=ODD)
def test_a_file_that_is_no_lease_does_not_hold_a_frame(leases, tmp_path, content):
    path = tmp_path / ".wave_0001.claim"
    path.write_bytes(content)
    assert leases.acquire(1) is None
    os.utime(path, (time.time() - 2 * UNSIGNED_S,) * 2)
    lease = leases.acquire(1)
    assert lease.generation == 1
    leases.release(lease)
    assert names(tmp_path) == []


def test_a_folder_or_pipe_in_the_place_of_a_lease_does_not_hold_a_frame(leases, tmp_path):
    (tmp_path / ".wave_0001.claim").mkdir()
    os.mkfifo(tmp_path / ".wave_0001.claim.1")
    for name in names(tmp_path):
        os.utime(tmp_path / name, (time.time() - 2 * UNSIGNED_S,) * 2)
    lease = leases.acquire(1)
    assert lease.generation == 2
    leases.release(lease)
    assert names(tmp_path) == [".wave_0001.claim"]  # nothing that is not a lease is deleted with what it holds
    assert leases.acquire(1).generation == 1


def test_the_owner_notices_that_its_lease_was_superseded(leases, tmp_path):
    lease = leases.acquire(1)
    assert leases.holds(lease)
    leave(tmp_path, generation=1)
    assert not leases.holds(lease)
    leases.release(lease)
    assert names(tmp_path) == [".wave_0001.claim.1"]


def test_the_later_of_two_leases_gives_way(tmp_path, dead_pid):
    """Before ours is created, another process supersedes the dead lease and finishes, and a third one begins."""
    dead = leave(tmp_path, pid=dead_pid)

    class LateLeases(FrameLeases):
        def _create(self, lease):
            dead.unlink()
            leave(tmp_path)
            return super()._create(lease)

    with LateLeases(tmp_path, "wave") as leases:
        assert leases.acquire(1) is None
    assert names(tmp_path) == [".wave_0001.claim"]


def test_a_lease_is_kept_fresh(tmp_path):
    with FrameLeases(tmp_path, "wave", refresh_s=0.01) as leases:
        path = leases.acquire(1).path
        os.utime(path, (0, 0))
        end = time.monotonic() + 5
        while path.stat().st_mtime == 0 and time.monotonic() < end:
            time.sleep(0.005)
        assert path.stat().st_mtime > 0


def test_a_lease_that_cannot_be_written_is_an_error(tmp_path):
    with FrameLeases(tmp_path, "x" * 300) as leases, pytest.raises(LiveHandError, match="could not be written"):
        leases.acquire(1)


def test_two_processes_never_supersede_the_same_dead_lease(tmp_path, dead_pid, monkeypatch):
    """Threads stand for processes: each has its own FrameLeases, and releases every frame at once."""
    monkeypatch.setattr(os, "getpid", threading.get_native_id)
    frames, owners, overlaps, taken = range(60), Counter(), [], Counter()
    for frame in frames:
        text = json.dumps({"place": process_space(), "pid": dead_pid})
        (tmp_path / f".wave_{frame:04d}.claim").write_text(text)
    start = threading.Barrier(4)

    def acquire_all():
        with FrameLeases(tmp_path, "wave") as leases:
            start.wait()
            for frame in frames:
                lease = leases.acquire(frame)
                if lease:
                    owners[frame] += 1
                    taken[frame] += 1
                    if owners[frame] != 1:
                        overlaps.append(frame)
                    time.sleep(0.0005)
                    owners[frame] -= 1
                    leases.release(lease)

    threads = [threading.Thread(target=acquire_all) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert overlaps == []
    assert sum(taken.values()) > len(frames) / 2
    assert names(tmp_path) == []
