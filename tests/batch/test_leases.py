"""FrameLeases on frames: one owner each, whatever dies, sleeps or races."""

import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter

import pytest
from livehand.backend.batch import leases as claims_module
from livehand.backend.batch.leases import STALE_S, UNSIGNED_S, FrameLeases, process_space
from livehand.backend.records.errors import LiveHandError


@pytest.fixture
def claims(tmp_path):
    with FrameLeases(tmp_path, "wave") as claims:
        yield claims


def names(folder):
    return sorted(os.listdir(folder))


@pytest.fixture(scope="module")
def dead_pid():
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def leave(folder, generation=0, pid=None, place=None, age_s=0.0):
    """Another process's claim on frame 1."""
    path = folder / (".wave_0001.claim" + (f".{generation}" if generation else ""))
    path.write_text(json.dumps({"place": place or process_space(), "pid": pid or os.getppid()}))
    os.utime(path, (time.time() - age_s,) * 2)
    return path


def test_a_frame_has_one_owner_until_it_is_given_back(claims, tmp_path):
    claim = claims.take(1)
    assert names(tmp_path) == [".wave_0001.claim"]
    owner = json.loads(claim.path.read_text())
    assert owner["pid"] == os.getpid()
    assert set(owner) == {"host", "place", "pid", "time"}
    with FrameLeases(tmp_path, "wave") as other:
        assert other.take(1) is None
        assert other.take(2) is not None
        assert other.take(10001) is not None
    assert names(tmp_path) == [".wave_0001.claim"]  # the other's end gave its own back
    claims.release(claim)
    assert names(tmp_path) == []
    assert claims.take(1) is not None


def test_other_shots_claims_do_not_count(claims, tmp_path):
    (tmp_path / ".wave_0001.claims").touch()
    (tmp_path / ".wave_0001_0001.claim").write_text("{}")
    assert claims.take(1).generation == 0


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
def test_only_the_dead_are_outnumbered_and_then_removed(claims, tmp_path, dead_pid, how, is_live):
    leave(tmp_path, **{name: dead_pid if value == "dead" else value for name, value in how.items()})
    claim = claims.take(1)
    if is_live:
        assert claim is None
        assert names(tmp_path) == [".wave_0001.claim"]
        return
    assert claim.generation == 1
    assert names(tmp_path) == [".wave_0001.claim", ".wave_0001.claim.1"]
    claims.release(claim)
    assert names(tmp_path) == []


def test_an_unsigned_claim_is_dead_after_a_moment(claims, tmp_path):
    path = tmp_path / ".wave_0001.claim"
    path.touch()
    assert claims.take(1) is None
    os.utime(path, (time.time() - 2 * UNSIGNED_S,) * 2)
    assert claims.take(1).generation == 1


def test_the_owner_notices_that_it_was_taken_over(claims, tmp_path):
    claim = claims.take(1)
    assert claims.holds(claim)
    leave(tmp_path, generation=1)
    assert not claims.holds(claim)
    claims.release(claim)
    assert names(tmp_path) == [".wave_0001.claim.1"]


def test_the_later_of_two_claims_gives_way(claims, tmp_path, dead_pid, monkeypatch):
    """Between our look and our claim another has taken over, finished, and a third has begun anew."""
    dead = leave(tmp_path, pid=dead_pid)
    make = claims._make

    def make_late(claim):
        dead.unlink()
        leave(tmp_path)
        return make(claim)

    monkeypatch.setattr(claims, "_make", make_late)
    assert claims.take(1) is None
    assert names(tmp_path) == [".wave_0001.claim"]


def test_a_claim_is_kept_fresh(tmp_path, monkeypatch):
    monkeypatch.setattr(claims_module, "BEAT_S", 0.01)
    with FrameLeases(tmp_path, "wave") as claims:
        path = claims.take(1).path
        os.utime(path, (0, 0))
        end = time.monotonic() + 5
        while path.stat().st_mtime == 0 and time.monotonic() < end:
            time.sleep(0.005)
        assert path.stat().st_mtime > 0


def test_a_claim_that_cannot_be_written_is_an_error(tmp_path):
    with FrameLeases(tmp_path, "x" * 300) as claims, pytest.raises(LiveHandError, match="could not be written"):
        claims.take(1)


def test_of_many_takers_of_a_dead_claim_never_two_win(tmp_path, dead_pid, monkeypatch):
    """Threads stand for processes: each has FrameLeases of its own, and every frame is given back at once."""
    monkeypatch.setattr(claims_module.os, "getpid", threading.get_native_id)
    frames, owners, overlaps, taken = range(60), Counter(), [], Counter()
    for frame in frames:
        text = json.dumps({"place": process_space(), "pid": dead_pid})
        (tmp_path / f".wave_{frame:04d}.claim").write_text(text)
    start = threading.Barrier(4)

    def take_all():
        with FrameLeases(tmp_path, "wave") as claims:
            start.wait()
            for frame in frames:
                claim = claims.take(frame)
                if claim:
                    owners[frame] += 1
                    taken[frame] += 1
                    if owners[frame] != 1:
                        overlaps.append(frame)
                    time.sleep(0.0005)
                    owners[frame] -= 1
                    claims.release(claim)

    threads = [threading.Thread(target=take_all) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert overlaps == []
    assert sum(taken.values()) > len(frames) / 2
    assert names(tmp_path) == []
