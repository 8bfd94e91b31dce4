"""The cost of a frame, and frames as PNG files."""

import numpy as np
import pytest
import torch
from livehand.backend.benchmark.cases import SYNC, WRITE, frame_cost, write_png
from livehand.backend.benchmark.stopwatch import Cost
from livehand.backend.records.frame import Frame
from livehand.backend.rendering.srgb import srgb_to_linear
from PIL import Image


def test_a_frame_excludes_writing_the_file_and_synchronising():
    stages = {"pose": Cost(1, 0.1), "field": Cost(2, 0.2), WRITE: Cost(100, 9), SYNC: Cost(1000, 90)}
    assert frame_cost(stages) == pytest.approx(Cost(3, 0.3))


def test_a_written_frame_is_srgb_with_straight_alpha(tmp_path):
    linear = srgb_to_linear(torch.tensor(200 / 255)).item()
    frame = Frame(np.full((2, 3, 3), linear * 0.4, np.float32), np.full((2, 3), 0.4, np.float32), np.zeros((2, 3)))
    write_png(frame, tmp_path / "frame.png")
    image = Image.open(tmp_path / "frame.png")
    assert (image.mode, image.size) == ("RGBA", (3, 2))
    assert image.getpixel((1, 1)) == (200, 200, 200, 102)
