"""The cost of a frame, and frames as PNG files."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.framing import fitting_camera
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.image.frame_writer import write_png
from livehand.backend.image.srgb import srgb_to_linear
from livehand.backend.records.frame import Frame
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.research.benchmark.cases import SYNC, WRITE, frame_cost, load_configurations
from livehand.backend.research.benchmark.stopwatch import Cost
from PIL import Image


def test_a_frame_excludes_writing_the_file_and_synchronising():
    stages = {"pose": Cost(1, 0.1), "field": Cost(2, 0.2), WRITE: Cost(100, 9), SYNC: Cost(1000, 90)}
    assert frame_cost(stages) == pytest.approx(Cost(3, 0.3))


def test_a_frame_that_was_rendered_before_costs_all_its_stages(hand):
    """A relightable avatar keeps its last hand for the next light."""
    configuration = load_configurations(hand, torch.device("cpu"), None, None)[0]
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3))
    vertices = posed_vertices(hand, pose)
    shot = Shot(pose, vertices, fitting_camera(vertices, (0.0, 1.0, 0.0), (48, 64), 0.9))
    stages = [[], []]
    for begun in stages:
        configuration.render(shot, begun.append)
    assert stages[0] == stages[1]
    assert "sample" in stages[0]


def test_a_written_frame_is_srgb_with_straight_alpha(tmp_path):
    linear = srgb_to_linear(torch.tensor(200 / 255)).item()
    frame = Frame(np.full((2, 3, 3), linear * 0.4, np.float32), np.full((2, 3), 0.4, np.float32), np.zeros((2, 3)))
    write_png(frame, tmp_path / "frame.png")
    image = Image.open(tmp_path / "frame.png")
    assert (image.mode, image.size) == ("RGBA", (3, 2))
    assert image.getpixel((1, 1)) == (200, 200, 200, 102)
