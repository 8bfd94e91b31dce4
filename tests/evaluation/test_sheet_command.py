import json

import numpy as np
import pytest
from livehand.backend.evaluation.contact_sheet import BACKGROUND
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image


def run(*arguments):
    return run_commands("livehand", "", COMMANDS, ["sheet", *map(str, arguments)])


def write_frames(folder, count, size_px=(4, 6)):
    """Frame k is opaque grey 10 k on its left half and transparent on its right."""
    for k in range(count):
        pixels = np.zeros((size_px[1], size_px[0], 4), np.uint8)
        pixels[:, : size_px[0] // 2] = (10 * k, 10 * k, 10 * k, 255)
        Image.fromarray(pixels).save(folder / f"wave_{k + 1:04d}.png")


def test_frames_lie_row_by_row_on_the_background(tmp_path, capsys):
    write_frames(tmp_path, 5)
    assert run(tmp_path, "--columns", 3, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"sheet": str(tmp_path / "contact_sheet.png"), "frames": 5}
    sheet = np.asarray(Image.open(tmp_path / "contact_sheet.png"))
    assert sheet.shape == (12, 12, 3)
    for k in range(5):
        top, left = k // 3 * 6, k % 3 * 4
        assert (sheet[top : top + 6, left : left + 2] == 10 * k).all()
        assert (sheet[top : top + 6, left + 2 : left + 4] == round(BACKGROUND * 255)).all()


def test_a_second_sheet_does_not_contain_the_first(tmp_path, capsys):
    write_frames(tmp_path, 2)
    (tmp_path / ".wave_0003.part.png").write_bytes(b"half a frame")
    assert run(tmp_path) == 0
    assert run(tmp_path) == 0
    assert capsys.readouterr().out.splitlines() == [f"{tmp_path / 'contact_sheet.png'}: 2 frames"] * 2


@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda folder: None, "must hold PNG frames, got none"),
        (lambda folder: (folder / "a.png").write_bytes(b"no picture"), "must be a readable image"),
        (lambda folder: (write_frames(folder, 2), write_frames(folder, 1, (8, 6))), "must be of one size"),
    ],
)
def test_bad_folders_are_refused_and_nothing_is_written(tmp_path, capsys, prepare, message):
    prepare(tmp_path)
    assert run(tmp_path) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "contact_sheet.png").exists()


def test_zero_columns_are_a_usage_error(tmp_path):
    assert run(tmp_path, "--columns", 0) == 2


def test_an_unwritable_path_is_refused(tmp_path, capsys):
    write_frames(tmp_path, 1)
    (tmp_path / "file").touch()
    assert run(tmp_path, "-o", tmp_path / "file" / "sheet.png") == 1
    assert "must be writable" in capsys.readouterr().err
