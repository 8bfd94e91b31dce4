"""How many processes compile the kernels, and what each does."""

import re
import threading
import time
from types import SimpleNamespace

import pytest
from livehand.backend.render.ahead import job
from livehand.backend.render.ahead.job import LAST_REQUEST, READY, first_requests


@pytest.mark.parametrize(("threads", "count"), [("1", 1), ("2", 2), ("64", 4)])
def test_there_is_a_process_for_each_core_and_at_most_four(monkeypatch, threads, count):
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    assert first_requests() == [[number, count] for number in range(count)]


def test_each_process_does_what_it_is_asked(monkeypatch):
    done = []
    monkeypatch.setattr(job, "prepare_share", lambda path, *share: done.append(share[:2]))
    monkeypatch.setattr(job, "prepare_kernels", lambda path: done.append("all"))
    monkeypatch.setattr(job, "give_way", lambda: done.append("gives way"))
    monkeypatch.setattr(job, "gc", SimpleNamespace(disable=lambda: done.append("keeps all")))
    monkeypatch.setattr(job, "_count", lambda report, is_ready: report("counted"))
    said = []
    for request in (*first_requests()[:1], LAST_REQUEST):
        assert job._prepared(request, said.append)["seconds"] >= 0
    assert done == ["keeps all", (0, len(first_requests())), "keeps all", "gives way", "all"]
    assert said == ["counted"]


def test_a_process_counts_until_it_is_ready_and_then_says_so_while_it_goes_on(monkeypatch):
    said, goes_on = [], threading.Event()

    def prepare(path, number, count, on_first):
        assert goes_on.wait(10)
        on_first()
        until = time.monotonic() + 10
        while said[-1].text != READY and time.monotonic() < until:
            time.sleep(0.01)
        said.append("finished")

    def report(progress):
        said.append(progress)
        goes_on.set()

    monkeypatch.setattr(job, "prepare_share", prepare)
    monkeypatch.setattr(job, "gc", SimpleNamespace(disable=lambda: None))
    monkeypatch.setattr(job, "_LOOK_S", 0.01)
    job._prepared([0, 1], report)
    *counted, ready, end = said
    assert counted
    assert all(re.fullmatch(r"\d+ of \d+", one.text) for one in counted)
    assert (ready.text, end) == (READY, "finished")
    assert 0 <= ready.share <= 1
