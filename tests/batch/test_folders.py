"""Output folders."""

import tempfile
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


@pytest.mark.parametrize("times", [1, 2])
def test_a_folder_that_another_process_removes_as_it_ends_is_made_again(tmp_path, monkeypatch, times):
    folder, make = tmp_path / "shared", tempfile.TemporaryFile
    left = [folder] * times

    def after_the_other(**place):
        if left:
            left.pop().rmdir()
        return make(**place)

    monkeypatch.setattr(tempfile, "TemporaryFile", after_the_other)
    with writable_folder(folder) as now_ns:
        (folder / "frame.exr").touch()
    assert (folder / "frame.exr").stat().st_mtime_ns >= now_ns
    assert not left


def test_a_folder_that_keeps_vanishing_is_an_error(tmp_path, monkeypatch):
    folder = tmp_path / "shared"

    def gone(**place):
        folder.rmdir()
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr(tempfile, "TemporaryFile", gone)
    with pytest.raises(LiveHandError, match="must be writable"), writable_folder(folder):
        pass
