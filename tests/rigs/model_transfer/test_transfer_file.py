"""Registrations are made once for each file, and again when what is kept is damaged."""

import numpy as np
import pytest
from livehand.backend.rigs.model_transfer import transfer_file
from livehand.backend.rigs.model_transfer.model_transfer import ModelTransfer
from livehand.backend.rigs.model_transfer.transfer_file import stored_transfer, transfer_path

pytestmark = pytest.mark.slow


@pytest.fixture
def made(tmp_path, monkeypatch, transfer):
    """How often a registration was made; the user's folder is empty."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    count = []

    class Counted(ModelTransfer):
        @classmethod
        def of(cls, ours, other):
            count.append(other.name)
            return transfer

    monkeypatch.setattr(transfer_file, "ModelTransfer", Counted)
    return count


def test_the_second_is_read_and_is_the_same(hand, twin, made, transfer):
    stored_transfer(hand, twin.model)
    again = stored_transfer(hand, twin.model)
    assert len(made) == 1
    for name in ("conformed", "weight"):
        np.testing.assert_array_equal(getattr(again.registration, name), getattr(transfer.registration, name))
    np.testing.assert_array_equal(again.registration.rest.theta, transfer.registration.rest.theta)
    np.testing.assert_array_equal(again.registration.points.face, transfer.registration.points.face)


def test_a_damaged_one_is_made_again(hand, twin, made):
    path = transfer_path(hand, twin.model)
    stored_transfer(hand, twin.model)
    with np.load(path) as arrays:
        changed = {**arrays, "face": arrays["face"] + 100_000}
    for spoilt in (b"no archive", path.read_bytes()[:1000], None):
        if spoilt is None:
            np.savez(path, **changed)
        else:
            path.write_bytes(spoilt)
        made.clear()
        stored_transfer(hand, twin.model)
        assert len(made) == 1
    made.clear()
    stored_transfer(hand, twin.model)
    assert made == []


def test_a_folder_that_cannot_be_written_does_not_matter(hand, twin, made, tmp_path):
    (tmp_path / "livehand").write_text("a file")
    assert stored_transfer(hand, twin.model).other.sha256 == twin.model.sha256
