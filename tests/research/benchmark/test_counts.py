"""The work of every stage, counted by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.records.camera import Camera
from livehand.backend.research.benchmark import counts as counts_module
from livehand.backend.research.benchmark.counts import (
    CHANNELS,
    Counts,
    Work,
    counts_of,
    field_work,
    gather_work,
    pixel_tests,
    pose_work,
    sample_work,
    stage_work,
    superres_work,
    volume_work,
)
from livehand.backend.research.benchmark.motion import MovingHand

SIZE = (84, 128)
COUNTS = Counts(100, 200, 3000, 50, 400, (20, 30), (64, 96))


def test_pixel_tests_by_hand():
    """A triangle with corners at (1, 1), (4, 1), (1, 3) px, over centres 1.5..3.5 x 1.5..2.5; then half outside."""
    vertices = np.array([[1.0, 1, 1], [4, 1, 1], [1, 3, 1]])
    camera = Camera(np.eye(3), np.eye(4), (10, 10))
    assert pixel_tests(vertices, np.array([[0, 1, 2]]), camera) == 6
    assert pixel_tests(vertices - [2, 0, 0], np.array([[0, 1, 2]]), camera) == 4
    assert pixel_tests(vertices - [9, 0, 0], np.array([[0, 1, 2]]), camera) == 0


def test_counts_of_a_shot(hand):
    """Two triangles that make a square of 0.2 m, 1 m away, facing the camera: no shell to speak of."""
    vertices = np.array([[-0.1, -0.1, 1], [0.1, -0.1, 1], [0.1, 0.1, 1], [-0.1, 0.1, 1]])
    square = SimpleNamespace(v_template=vertices, f=np.array([[0, 2, 1], [0, 3, 2]]))
    camera = Camera(np.array([[100.0, 0, 32], [0, 100, 32], [0, 0, 1]]), np.eye(4), (64, 64))
    shot = SimpleNamespace(vertices=vertices, camera=camera)
    counts = counts_module.counts_of.__wrapped__(shot, square, SamplerConfig(samples_per_ray=8, shell_m=1e-4))
    assert counts.rays == pytest.approx(100, abs=25)  # 10 x 10 low-resolution pixels, and what its edges touch
    assert counts.samples == 8 * counts.rays
    assert counts.pixel_tests == pytest.approx(2 * 2 * 100, rel=0.3)
    assert counts.crop_px == pytest.approx((10 + 12, 10 + 12), abs=2)
    assert (counts.vertices, counts.faces, counts.size_px) == (4, 2, (64, 64))


def test_counts_grow_with_the_frames_size(hand):
    small, large = (
        counts_of(motion.shot(motion.frames(1)[0]), hand, SamplerConfig())
        for motion in (MovingHand(hand, (167, 256)), MovingHand(hand, (334, 512)))
    )
    assert large.rays / small.rays == pytest.approx(4, rel=0.08)
    assert large.samples == 8 * large.rays
    assert (large.vertices, large.faces) == (len(hand.v_template), len(hand.f))


def test_work_by_hand():
    assert pose_work(COUNTS) == Work(2 * 100 * (435 + 192), 4 * 100 * (435 + 19))
    assert sample_work(COUNTS) == Work(6 * 92 * 400, 4 * (9 * 200 + 3 * 50) + 20 * 400)
    assert volume_work(COUNTS, 2) == Work(72 * 400, 2 * 33 * 400 + 4 * 34 * 50)


def test_the_papers_field_is_counted_as_torch_counts_it(hand):
    """92,577 parameters less biases (5 x 128 + 1 + 64 + 32) and the pose's part of the first layer."""
    field = new_avatar("a", hand.name, hand.sha256, PRESETS["paper"]).field
    weights = 92577 - (5 * 128 + 1 + 64 + 32) - 48 * 128
    work = field_work(COUNTS, field, 4)
    assert work.flop == 2 * weights * COUNTS.samples
    assert work.unit == "network"
    assert work.bytes == COUNTS.samples * (20 + 4 * 33) + 4 * weights


def test_a_plane_field_decodes_rays_instead_of_samples(hand):
    """Near and density layers run per sample, trunk and channels per ray; the light is computed per vertex."""
    field = new_avatar("a", hand.name, hand.sha256, PRESETS["default"]).field
    config = field.config
    features = sum(channels for _, _, channels in config.planes)
    near, width = features + 2 + 9, config.width
    of_samples = near * config.density_width + config.density_width
    of_rays = (near + 3 + 3 + 8 + 5) * width + width * width + width * CHANNELS
    touched = 4 * 400 * (features + 3)  # far fewer samples than texels
    gathered = 2 * of_samples * 400 + 2 * 4 * (features + 3) * 400
    assert gather_work(COUNTS, field) == Work(gathered, 20 * 400 + 4 * (of_samples + touched))
    assert field_work(COUNTS, field, 2) == Work(2 * of_rays * 50, 2 * (33 * 50 + of_rays), "network")


def test_the_papers_superres_by_hand(hand):
    superres = new_avatar("a", hand.name, hand.sha256, PRESETS["paper"]).superres
    low = 9 * CHANNELS * 128 + 9 * 128 * 128 + 128 * 4
    high = 9 * 128 * 64 + 9 * 64 * 64 + 64 * 4
    work = superres_work(COUNTS, superres, 4)
    assert work.flop == 2 * 20 * 30 * (low + 4 * high)
    assert next(superres.parameters()).device.type == "cpu"  # counting does not move the network


def test_every_stage_has_work(hand):
    works = stage_work(COUNTS, new_avatar("a", hand.name, hand.sha256, PRESETS["default"]), 2)
    assert list(works) == ["pose", "rasterise", "sample", "gather", "field", "volume", "superres", "decode"]
    assert all(work.flop > 0 and work.bytes > 0 for work in works.values())
