"""The benchmark's arithmetic: stopwatch, rounds, ratios, the moving hand, counts and floors, all by value."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from livehand.backend.benchmark import counts as counts_module
from livehand.backend.benchmark import machine
from livehand.backend.benchmark.cases import SYNC, WRITE, frame_cost, write_png
from livehand.backend.benchmark.counts import (
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
from livehand.backend.benchmark.floor import floor_ms, floors_ms
from livehand.backend.benchmark.growth import put_together
from livehand.backend.benchmark.machine import Peaks
from livehand.backend.benchmark.motion import MotionFrame, MovingHand, silhouette_px
from livehand.backend.benchmark.plot import Curve, Panel, round_up, save_plot
from livehand.backend.benchmark.rounds import Case, measure_rounds, paired_ratio, stage_spreads
from livehand.backend.benchmark.stopwatch import Cost, Spread, Stopwatch, spread
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.nerf.avatar import PRESETS, new_avatar
from livehand.backend.nerf.sampler import SamplerConfig
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import DEPTH_BACKGROUND, Frame, HandPose
from livehand.backend.rendering.srgb import srgb_to_linear
from PIL import Image

SIZE = (84, 128)
COUNTS = Counts(100, 200, 3000, 50, 400, (20, 30), (64, 96))


class Clock:
    """Two clocks that stand still unless told."""

    def __init__(self):
        self.wall_s, self.core_s, self.waits = 5.0, 2.0, 0

    def pass_by(self, wall_s, core_s):
        self.wall_s, self.core_s = self.wall_s + wall_s, self.core_s + core_s

    def stopwatch(self):
        return Stopwatch(lambda: self.wall_s, lambda: self.core_s, self.wait)

    def wait(self):
        self.waits += 1
        self.pass_by(0.25, 0.0)  # what the device was still at belongs to the stage that asked for it


def test_a_stopwatch_sums_stages_in_order_and_waits_for_the_device():
    clock = Clock()
    stopwatch = clock.stopwatch()
    for stage, wall_s, core_s in (("pose", 1, 2), ("field", 2, 3), ("pose", 4, 5)):
        stopwatch.begin(stage)
        clock.pass_by(wall_s, core_s)
    stages = stopwatch.stop()
    assert list(stages) == ["pose", "field"]
    assert stages == {"pose": Cost(5500, 7), "field": Cost(2250, 3)}
    assert clock.waits == 4
    assert stopwatch.stop() == {}


def test_writing_the_file_and_synchronising_are_no_part_of_a_frame():
    stages = {"pose": Cost(1, 0.1), "field": Cost(2, 0.2), WRITE: Cost(100, 9), SYNC: Cost(1000, 90)}
    assert frame_cost(stages) == pytest.approx(Cost(3, 0.3))


def test_a_spread_is_median_and_percentiles():
    assert spread([float(k) for k in range(11)]) == Spread(5, 1, 9)
    assert spread([3.0]) == Spread(3, 3, 3)


def of_ms(*values):
    return {number: {"all": Cost(value, value / 1000)} for number, value in enumerate(values)}


def test_ratios_are_of_the_same_rounds():
    """A busy round slows both down; a median of ratios does not care, a ratio of other rounds would."""
    fast, slow = of_ms(10.0, 50.0, 10.0, 10.0), {1: of_ms(0, 200.0)[1], 2: of_ms(0, 0, 40.0)[2]}
    assert paired_ratio(slow, fast) == pytest.approx(4)
    assert paired_ratio({}, fast) is None
    assert paired_ratio({7: slow[1]}, fast) is None


def test_stages_that_are_told_now_and_then_are_spread_over_their_own_frames():
    taken = {0: {"pose": Cost(1.0, 0.0)}, 1: {"pose": Cost(3.0, 0.0), "field": Cost(8.0, 0.0)}}
    assert {name: wall.median for name, (wall, _) in stage_spreads(taken).items()} == {"pose": 2, "field": 8}


CAMERA = Camera(np.eye(3), np.eye(4), (4, 4))


def run_rounds(cases, count):
    """Rounds whose moments are told apart by their translation."""
    poses = [replace(HandPose.rest(), transl=np.array([float(k), 0, 0])) for k in range(count)]
    return measure_rounds(cases, [MotionFrame(pose, CAMERA) for pose in poses])


def case_of(log, name, wall_ms=1000.0, **kwargs):
    def measure(moment):
        log.append((name, moment.pose.transl[0]))
        return {"all": Cost(wall_ms, 1.0)}

    return Case(name, measure, **kwargs)


def test_cases_take_turns_and_begin_in_turn():
    log = []
    results = run_rounds([case_of(log, name) for name in "ab"], 3)
    assert log == [("a", 0), ("b", 0), ("b", 1), ("a", 1), ("a", 2), ("b", 2)]
    assert [sorted(taken) for taken in results.values()] == [[0, 1, 2]] * 2


def test_a_case_stops_when_its_time_is_up_but_takes_two_frames():
    log = []
    cases = [case_of(log, "slow", budget_s=0.5), case_of(log, "dear", budget_s=3.5), case_of(log, "free")]
    results = run_rounds(cases, 8)
    assert {name: len(taken) for name, taken in results.items()} == {"slow": 2, "dear": 4, "free": 8}


def test_a_foreign_case_costs_the_others_a_frame_that_does_not_count():
    log = []
    cases = [case_of(log, "a"), case_of(log, "cycles", frames=1, is_foreign=True)]
    results = run_rounds(cases, 2)
    assert log == [("a", 0), ("a", 0), ("cycles", 0), ("a", 1)]
    assert {name: list(taken) for name, taken in results.items()} == {"a": [0, 1], "cycles": [0]}


@pytest.mark.parametrize(("frames", "rounds"), [(2, [0, 4]), (3, [0, 3, 6]), (20, list(range(8)))])
def test_a_case_of_few_frames_spreads_them_over_the_rounds(frames, rounds):
    results = run_rounds([case_of([], "cycles", frames=frames)], 8)
    assert list(results["cycles"]) == rounds


def test_the_motion_is_a_closed_loop_that_moves_and_stays_in_view(hand):
    motion = MovingHand(hand, SIZE)
    moments = motion.moments(24)
    vertices = np.stack([motion.shot(moment).vertices for moment in moments])
    steps_m = np.linalg.norm(vertices - np.roll(vertices, -1, 0), axis=-1).max(1)
    assert steps_m.min() > 1e-4
    assert steps_m.max() < 0.08  # the fist that opens, in four steps of 24
    for moment, posed in zip(moments, vertices, strict=True):
        pixels, depth = moment.camera.project(posed)
        assert depth.min() > 0.5
        assert pixels.min() > 0
        assert (pixels.max(0) < SIZE).all()


def test_the_motion_is_the_same_every_time_and_at_every_size(hand):
    (_, one), (_, other) = MovingHand(hand, SIZE).moments(2), MovingHand(hand, (168, 256)).moments(2)
    np.testing.assert_array_equal(one.pose.theta, other.pose.theta)
    np.testing.assert_allclose(other.camera.K[:2], 2 * one.camera.K[:2])
    np.testing.assert_array_equal(MovingHand(hand, SIZE).moments(2)[1].pose.theta, one.pose.theta)


@pytest.mark.parametrize(("coverage", "low", "high"), [(None, 0.21, 0.27), (0.1, 0.09, 0.11), (0.04, 0.035, 0.045)])
def test_the_hand_covers_what_was_asked(hand, coverage, low, high):
    """The example's mean is 0.226 of 334x512, between 0.18 and 0.31."""
    motion = MovingHand(hand, SIZE, coverage)
    assert low < np.mean([motion.covered(moment) for moment in motion.moments(6)]) < high


def test_a_silhouette_is_the_rasterisers(hand):
    motion = MovingHand(hand, (167, 256))
    shot = motion.shot(motion.moments(3)[1])
    pixels, depth = (torch.as_tensor(v, dtype=torch.float32) for v in shot.camera.project(shot.vertices))
    exact = len(rasterise(pixels, depth, torch.as_tensor(hand.f), shot.camera.size_px).pixel.unique())
    assert silhouette_px(shot.vertices, hand.f, shot.camera) == pytest.approx(exact, rel=0.06)


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
    assert counts.window_px == pytest.approx((10 + 12, 10 + 12), abs=2)
    assert (counts.vertices, counts.faces, counts.size_px) == (4, 2, (64, 64))


def test_counts_grow_with_the_frames_size(hand):
    small, large = (
        counts_of(motion.shot(motion.moments(1)[0]), hand, SamplerConfig())
        for motion in (MovingHand(hand, (167, 256)), MovingHand(hand, (334, 512)))
    )
    assert large.rays / small.rays == pytest.approx(4, rel=0.08)
    assert large.samples == 8 * large.rays
    assert (large.vertices, large.faces) == (len(hand.v_template), len(hand.f))


def test_the_works_by_hand():
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


def test_a_field_of_planes_decodes_rays_not_samples(hand):
    """Near and density at samples, trunk and channels once a ray; the light is a vertex' own."""
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
    assert next(superres.parameters()).device.type == "cpu"  # counting leaves the network where it is


def test_every_stage_has_work(hand):
    works = stage_work(COUNTS, new_avatar("a", hand.name, hand.sha256, PRESETS["default"]), 2)
    assert list(works) == ["pose", "rasterise", "sample", "gather", "field", "volume", "superres", "develop"]
    assert all(work.flop > 0 and work.bytes > 0 for work in works.values())


PEAKS = Peaks(1e9, 4e9, 1e8)


@pytest.mark.parametrize(
    ("work", "precision", "expected_ms"),
    [
        (Work(2e6, 1e5), "fp32", 2.0),
        (Work(2e6, 1e5), "bf16", 2.0),  # geometry is always single precision
        (Work(2e6, 1e4, "network"), "bf16", 0.5),
        (Work(2e6, 1e4, "network"), "fp32", 2.0),
        (Work(2e6, 5e5), "fp32", 5.0),
    ],
)
def test_a_floor_is_the_larger_of_arithmetic_and_bytes(work, precision, expected_ms):
    assert floor_ms(work, PEAKS, precision) == pytest.approx(expected_ms)


def test_a_stage_that_is_not_told_adds_its_floor_to_the_one_it_is_done_within():
    works = {name: Work(k * 1e6, 0) for k, name in enumerate(("pose", "rasterise", "sample", "field", "volume"), 1)}
    assert floors_ms(works, PEAKS, "fp32", works) == {"pose": 1, "rasterise": 2, "sample": 3, "field": 4, "volume": 5}
    assert floors_ms(works, PEAKS, "fp32", ["pose", "sample", "field"]) == {"pose": 1, "sample": 5, "field": 9}


def test_a_march_samples_gathers_and_composites_in_one_stage():
    works = {name: Work(k * 1e6, 0) for k, name in enumerate(("rasterise", "sample", "gather", "volume", "field"), 1)}
    told = ["rasterise", "sample", "field"]
    assert floors_ms(works, PEAKS, "fp32", told) == {"rasterise": 1, "sample": 9, "field": 5}
    assert floors_ms(works, PEAKS, "fp32", told[1:]) == {"sample": 3, "field": 12}


def test_the_better_peaks_count():
    assert Peaks(1.0, 5.0, 3.0).or_better(Peaks(2.0, 4.0, 3.0)) == Peaks(2, 5, 3)


def test_peaks_by_a_clock_that_moves_a_second_at_each_look(monkeypatch):
    monkeypatch.setattr(machine, "_PRODUCTS", {"cpu": ((2, 3, 4), (5, 6, 7))})
    monkeypatch.setattr(machine, "_COPY_MB", {"cpu": 1})
    for convolution, flops in (((1, 2), 2 * 5 * 6 * 7), ((4, 8), 2 * 9 * 4 * 4 * 8 * 8)):  # the higher counts
        monkeypatch.setattr(machine, "_CONVOLUTION", {"cpu": convolution})
        peaks = machine.measure_peaks(torch.device("cpu"), wall_s=iter(np.arange(1000.0).tolist()).__next__)
        assert peaks == Peaks(flops, flops, 2 * 2**20)


def test_hands_are_put_together_by_depth():
    def a_frame(rgb, alpha, depth):
        return Frame(np.full((1, 1, 3), rgb), np.full((1, 1), alpha), np.full((1, 1), depth))

    far, near, none = a_frame(0.8, 1.0, 2.0), a_frame(0.1, 0.25, 1.0), a_frame(0.0, 0.0, DEPTH_BACKGROUND)
    for frames in ([far, near, none], [none, near, far]):
        together = put_together(frames)
        np.testing.assert_allclose(together.rgb, 0.1 + 0.75 * 0.8)
        np.testing.assert_allclose(together.alpha, 1)
        np.testing.assert_allclose(together.depth, 1)


def test_a_written_frame_is_srgb_with_straight_alpha(tmp_path):
    linear = srgb_to_linear(torch.tensor(200 / 255)).item()
    frame = Frame(np.full((2, 3, 3), linear * 0.4, np.float32), np.full((2, 3), 0.4, np.float32), np.zeros((2, 3)))
    write_png(frame, tmp_path / "frame.png")
    image = Image.open(tmp_path / "frame.png")
    assert (image.mode, image.size) == ("RGBA", (3, 2))
    assert image.getpixel((1, 1)) == (200, 200, 200, 102)


@pytest.mark.parametrize(("value", "end"), [(0.41, 0.5), (3.9, 4), (4.0, 4), (11.0, 20), (81.0, 100), (0.004, 0.004)])
def test_an_axis_ends_at_a_round_number(value, end):
    assert round_up(value) == pytest.approx(end)


def test_a_plot_draws_every_panel_and_curve(tmp_path):
    curve = Curve("default_bf16", [(1.0, 10.0), (2.0, 20.0)], [(9.0, 12.0), (18.0, 25.0)])
    save_plot([Panel("one", "hands", [curve]), Panel("two", "hands", [curve, curve])], tmp_path / "new" / "plot.png")
    pixels = np.asarray(Image.open(tmp_path / "new" / "plot.png")).astype(int)
    width = pixels.shape[1] // 2
    coloured = np.ptp(pixels, axis=-1) > 60
    middle = 70 + round((440 - 70 - 24) * 0.75)  # x = 1.5 of 2: between the curve's points
    assert coloured[80:, middle].any()
    assert coloured[:, :width].sum() > 300
    assert coloured[:, width + 80 : width + 180].sum() > coloured[:, 80:180].sum()  # two names instead of one
    (tmp_path / "file").write_text("")
    with pytest.raises(LiveHandError, match="could not be written"):
        save_plot([Panel("one", "hands", [curve])], tmp_path / "file" / "plot.png")
