"""Who has a lease: what a process signs is read back, and what others wrote is nobody."""

import os

import pytest
from livehand.backend.batch import leases as lease_owner
from livehand.backend.batch.leases import LeaseOwner, read_owner, signature
from livehand.backend.system.processes import process_space


def test_a_signature_names_this_process(tmp_path):
    path = tmp_path / "lease"
    path.write_text(signature())
    owner = read_owner(path)
    assert owner == LeaseOwner(process_space(), os.getpid())
    assert not owner.has_ended()


def test_only_processes_of_this_place_are_known_to_have_ended(monkeypatch):
    monkeypatch.setattr(lease_owner, "is_running", lambda pid: False)
    assert LeaseOwner(process_space(), 1).has_ended()
    assert not LeaseOwner("another machine", 1).has_ended()


@pytest.mark.parametrize("content", [b"", b"7", b'{"place": "here"}', b'{"place": "here", "pid": -1}', b"\xff"])
def test_other_content_names_nobody(tmp_path, content):
    (tmp_path / "lease").write_bytes(content)
    assert read_owner(tmp_path / "lease") is None


def test_a_lease_that_may_not_be_read_is_told_apart(tmp_path, monkeypatch):
    (tmp_path / "lease").write_text(signature())
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PermissionError):
        read_owner(tmp_path / "lease")
