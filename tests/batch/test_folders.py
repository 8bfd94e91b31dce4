"""Output folders."""

from pathlib import Path

import pytest
from livehand.backend.batch.folders import folders_of, writable_folder
from livehand.backend.records.errors import LiveHandError


def test_each_of_several_shots_has_a_folder_of_its_name(tmp_path):
    assert folders_of([Path("wave.blend")], tmp_path) == {Path("wave.blend"): tmp_path}
    assert folders_of([Path("a/one.blend"), Path("two.blend")], tmp_path) == {
        Path("a/one.blend"): tmp_path / "one",
        Path("two.blend"): tmp_path / "two",
    }


def test_shots_of_one_name_are_an_error(tmp_path):
    with pytest.raises(LiveHandError, match=r"got a\.blend and a\.blend"):
        folders_of([Path("a.blend"), Path("a.blend")], tmp_path)


def test_a_new_folder_stays_only_if_it_has_files(tmp_path):
    with writable_folder(tmp_path / "a" / "empty"):
        pass
    with writable_folder(tmp_path / "full"):
        (tmp_path / "full" / "frame.exr").touch()
    assert not (tmp_path / "a" / "empty").exists()
    assert (tmp_path / "full").exists()


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(LiveHandError, match="must be writable"), writable_folder(tmp_path / "file" / "frames"):
        pass
