"""Names of frames and of their temporary files, and leftovers of killed runs."""

from pathlib import Path

import pytest
from livehand.backend.batch.frame_paths import FrameParts, FramePaths, frames_with_leftovers
from livehand.backend.records.errors import LiveHandError
from PIL import Image


@pytest.fixture
def paths(tmp_path):
    return FramePaths(tmp_path, "wave", 7)


def names(paths):
    return sorted(path.name for path in paths.folder.iterdir())


def test_published_parts_have_the_frames_name_and_others_are_removed(paths):
    with FrameParts(paths, "0a1b") as parts:
        part = parts.path("png")
        assert part.name == ".wave_0007.0a1b.part.png"
        Image.new("RGBA", (3, 2)).save(part)
        parts.check(part, (3, 2))
        parts.publish()
        parts.path("exr").touch()
    assert names(paths) == ["wave_0007.png"]
    assert paths.missing(("exr", "png"), (3, 2), 0) == ["exr"]
    assert paths.missing(("png",), (3, 3), 0) == ["png"]
    assert paths.missing(("png",), (3, 2), paths.path("png").stat().st_mtime_ns + 1) == ["png"]


def test_whenever_publishing_ends_no_image_lies_beside_the_record_of_another(paths, monkeypatch):
    """Kills stand at every step of the second frame's publishing."""
    steps = []

    def publish(content, most_steps):
        def counted(do):
            def step(*arguments, **options):
                if len(steps) == most_steps:
                    raise KeyboardInterrupt
                steps.append(do)
                return do(*arguments, **options)

            return step

        steps.clear()
        with FrameParts(paths, "0a1b") as parts, monkeypatch.context() as patched:
            for suffix in ("json", "exr", "png"):
                parts.path(suffix).write_text(content)
            for name in ("unlink", "replace"):
                patched.setattr(Path, name, counted(getattr(Path, name)))
            parts.publish()

    for most_steps in range(5):
        publish("old", 99)
        with pytest.raises(KeyboardInterrupt):
            publish("new", most_steps)
        found = {path.suffix: path.read_text() for path in paths.folder.glob("wave*")}
        assert set(found.values()) in ({"old"}, {"new"}), (most_steps, found)


def test_nothing_is_removed_by_a_process_whose_parts_are_gone(paths):
    paths.path("png").write_text("of another process")
    with FrameParts(paths, "0a1b") as parts:
        for suffix in ("json", "png"):
            parts.path(suffix).touch()
        paths.remove_parts()
        with pytest.raises(LiveHandError, match="could not be written"):
            parts.publish()
    assert paths.path("png").read_text() == "of another process"


def test_a_part_that_does_not_decode_is_an_error(paths):
    with FrameParts(paths, "0a1b") as parts:
        part = parts.path("png")
        part.touch()
        with pytest.raises(LiveHandError, match=r"wave_0007\.png could not be written"):
            parts.check(part, (3, 2))
    assert names(paths) == []


def test_leftovers_are_leases_and_parts_of_this_shot(tmp_path):
    mine = {".wave_0001.claim": 1, ".wave_-004.claim.2": -4, ".wave_0002.part.exr": 2, ".wave_0009.0a1b.part.png": 9}
    for name in (*mine, "wave_0003.exr", ".other_0005.claim", ".wave_b_0006.part.exr", ".wave_0007.claims"):
        (tmp_path / name).touch()
    assert frames_with_leftovers(tmp_path, "wave") == sorted(mine.values())


def test_parts_of_other_frames_are_kept(paths):
    for name in (".wave_0007.0a1b.part.exr", ".wave_0007.part.png", ".wave_0008.0a1b.part.exr"):
        (paths.folder / name).touch()
    paths.remove_parts()
    assert names(paths) == [".wave_0008.0a1b.part.exr"]
