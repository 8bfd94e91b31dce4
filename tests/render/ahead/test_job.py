"""How many processes compile the kernels, and what each does."""

from types import SimpleNamespace

import pytest
from livehand.backend.render.ahead import job
from livehand.backend.render.ahead.job import LAST_REQUEST, first_requests


@pytest.mark.parametrize(("threads", "count"), [("1", 1), ("2", 2), ("64", 4)])
def test_there_is_a_process_for_each_core_and_at_most_four(monkeypatch, threads, count):
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    assert first_requests() == [[number, count] for number in range(count)]


def test_each_process_does_what_it_is_asked(monkeypatch):
    done = []
    monkeypatch.setattr(job, "prepare_share", lambda path, *share: done.append(share))
    monkeypatch.setattr(job, "prepare_kernels", lambda path: done.append("all"))
    monkeypatch.setattr(job, "give_way", lambda: done.append("gives way"))
    monkeypatch.setattr(job, "gc", SimpleNamespace(disable=lambda: done.append("keeps all")))
    monkeypatch.setattr(job, "_count", lambda report: report("counted"))
    said = []
    for request in (*first_requests()[:1], LAST_REQUEST):
        assert job._prepared(request, said.append)["seconds"] >= 0
    assert done == ["keeps all", (0, len(first_requests())), "keeps all", "gives way", "all"]
    assert said == ["counted"]
