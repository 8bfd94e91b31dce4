"""SMPLpix: sizes as published, windows of any size, augmentation, and a fit that goes on where it was killed."""

from dataclasses import replace
from math import pi

import pytest
import torch
from livehand.backend.evaluation.shot_renderer import ShotRenderer
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.records.shot import Shot
from livehand.backend.research.baselines import fitting
from livehand.backend.research.baselines.method import Budget
from livehand.backend.research.baselines.smplpix import SMPLPIX, UNet, draw, turned
from livehand.backend.research.baselines.weights_file import load_method


def test_the_network_has_the_published_sizes(parameters):
    assert parameters(UNet(3, 3, 32)) == 8_637_411
    assert parameters(UNet(3, 4, 16)) == 2_162_180


@pytest.mark.parametrize("size", [(1, 1), (17, 33), (48, 31)])
def test_windows_of_any_size(size):
    network = UNet(3, 4, 2).eval()
    image = torch.rand(2, 3, *size)
    found = network(image)
    assert found.shape == (2, 4, *size)
    padded = torch.nn.functional.pad(image, (0, -size[1] % 16, 0, -size[0] % 16))
    torch.testing.assert_close(found, network(padded)[:, :, : size[0], : size[1]])


def test_turning_scaling_and_moving():
    image = torch.zeros(1, 40, 60)
    image[0, 18:22, 38:42] = 1  # 10 px to the right of the middle

    def centre(*change):
        found = turned(image, *change, 64)[0]
        rows, columns = torch.meshgrid(torch.arange(64) + 0.5, torch.arange(64) + 0.5, indexing="ij")
        return float((found * columns).sum() / found.sum()) - 32, float((found * rows).sum() / found.sum()) - 32

    assert centre(0.0, 1.0, (0.0, 0.0)) == pytest.approx((10, 0), abs=0.01)
    assert centre(pi / 2, 1.0, (0.0, 0.0)) == pytest.approx((0, 10), abs=0.01)
    assert centre(0.0, 1.5, (0.0, 0.0)) == pytest.approx((15, 0), abs=0.1)
    assert centre(0.0, 1.0, (-7.0, 4.0)) == pytest.approx((3, 4), abs=0.01)


def test_the_drawing_holds_normals_in_the_cameras_axes(posed, view_from):
    hand = posed("open")
    view = view_from(hand.mesh, [0, 1, 0.2])
    drawing, depth = draw(hand.mesh, hand.topology, view, hand.mesh.vertices, "surface")
    assert drawing.shape == (6, 44, 48)
    is_hand = depth.isfinite()
    assert (drawing[:, ~is_hand] == 0).all()
    torch.testing.assert_close(drawing[:3, is_hand].norm(dim=0), torch.ones(int(is_hand.sum())))
    assert drawing[2, is_hand].mean() < -0.4  # towards the camera


class KilledFit(Exception):
    pass


def test_a_killed_fit_ends_as_an_unbroken_one(painted_capture, hand, machine, cpu, tmp_path, monkeypatch):
    method = replace(SMPLPIX, width=2)
    budget = Budget(steps=8)
    method.fit(painted_capture, hand, budget, tmp_path / "whole", machine)
    save, saved = fitting.save_checkpoint, []

    def save_and_die(path, state, progress, identity):
        save(path, state, progress, identity)
        saved.append(progress.step)
        if len(saved) == 1:
            raise KilledFit

    monkeypatch.setattr(fitting, "save_checkpoint", save_and_die)
    train_config = Budget.train_config
    monkeypatch.setattr(Budget, "train_config", lambda self, *a, **k: train_config(self, *a, checkpoint_every=2, **k))
    with pytest.raises(KilledFit):
        method.fit(painted_capture, hand, budget, tmp_path / "killed", machine)
    fitted = method.fit(painted_capture, hand, budget, tmp_path / "killed", machine)
    assert saved == [2, 4, 4]
    assert fitted.steps == 4
    whole, resumed = (load_method(tmp_path / name, "smplpix")[0] for name in ("whole", "killed"))
    for name, value in whole.items():
        torch.testing.assert_close(resumed[name], value, atol=1e-5, rtol=1e-4)
    renderer = method.load(tmp_path / "killed", hand, cpu)
    assert isinstance(renderer, ShotRenderer)
    pose, view = painted_capture.poses[0], painted_capture.views[3]
    frame = renderer.render(Shot(pose, posed_vertices(hand, pose), view.camera))
    assert frame.rgb.shape == (32, 24, 3)
