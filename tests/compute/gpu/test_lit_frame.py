"""Whole frames as one sequence, on Warp's CPU device and a GPU if there is one, against the reference's."""

import logging
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
import warp as wp
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.gpu import frame_shape, lit_frame
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.gpu.frame_shape import FrameShape
from livehand.backend.field.field import BakedField, FieldConfig, PaperField
from livehand.backend.image.superres import PaperSuperRes, SuperResConfig
from livehand.backend.records.light import Light, MeasuredLight
from livehand.backend.render.composition import joined, visible_parts
from livehand.backend.render.lit_shots import LitShots, reason_for_stages, reason_of_avatar
from livehand.backend.surface.albedo_ratio import AlbedoRatio

from .conftest import AREAS, SKY, SUN
from .whole_frames import (
    FLIPPED,
    FLIPPED_OF_LEFT,
    assert_same_frame,
    kinds,
    knuckle_of_a_fist,
    new_buffers,
    off_by,
    rendered_at_once,
    sequence_of,
    with_blood_in_joints,
)

pytestmark = pytest.mark.slow

BY_DAY = (
    "right",
    "left",
    "past the border",
    "without lamps",
    "in the capture's light",
    "sculpted",
    "in fine shadows of objects",
    "pressed",
)
"""Launch all kernels between them, and take all roads of the host; the others are mixed of these."""
MOST_LAUNCHES, MOST_OF_ANY = 60, 71
"""Of what the gates are for, and of a frame that has hair and stands beside coloured objects."""


def by_day(names):
    return [one if one in BY_DAY else pytest.param(one, marks=pytest.mark.nightly) for one in names]


@pytest.mark.parametrize("kind", by_day(kinds()))
def test_a_frame_at_once_is_the_cpus(ours, theirs, device, kind):
    shot = kinds()[kind]
    theirs.forget()
    is_exact = shot.pose.side == "left" and device.type == "cpu"  # a GPU's networks are in half precision
    flipped = FLIPPED_OF_LEFT if is_exact else FLIPPED
    assert_same_frame(rendered_at_once(ours, shot), theirs.render(replace(shot, quality="final")), flipped)


def test_rays_that_gather_nothing_are_lit_as_the_cpus(ours, theirs):
    """Where the surface stands beyond their shell; without its normal 25 pixels would be dark."""
    shot = knuckle_of_a_fist()
    theirs.forget()
    at_once, expected = rendered_at_once(ours, shot), theirs.render(shot)
    solid = (at_once.alpha > 0.9) & (expected.alpha > 0.9)
    assert solid.sum() > 4000
    assert ((at_once.rgb.max(-1) < 0.7 * expected.rgb.max(-1)) & solid).sum() <= 5


LIT_BESIDE = {
    "with hair": {"hair": 0.0},
    "beside black objects": {"occluders": np.zeros((0, 3, 3))},
    "beside coloured objects": {"occluder_albedo": np.zeros((0, 3))},
    "in fine shadows": {"shadow_quality": "coarse"},
    "in fine shadows of a bright window": {"shadow_quality": "coarse"},
    "pressed": {"pressed_m": None},
}


@pytest.mark.parametrize("kind", by_day(LIT_BESIDE))
def test_what_makes_a_kind_counts_more_than_frames_may_differ(theirs, kind):
    """Else the test above would not see it missing."""
    shot, change = kinds()[kind], LIT_BESIDE[kind]
    of_light = {name: value for name, value in change.items() if hasattr(shot.light, name)}
    changed = replace(shot, light=replace(shot.light, **of_light)) if of_light else replace(shot, **change)
    theirs.forget()
    with_it = theirs.render(shot)
    assert off_by(theirs.render(changed), with_it) > 2 * FLIPPED_OF_LEFT


@pytest.fixture(scope="module")
def drawn(ours, theirs):
    """The same renderers of a person with blood in the joints."""
    avatar = with_blood_in_joints(ours.avatar)
    return replace(ours, avatar=avatar), replace(theirs, avatar=avatar)


@pytest.mark.parametrize("is_pressed", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_joints_that_pale_as_they_bend_are_the_cpus(drawn, theirs, device, is_pressed):
    """A hand whose fingers are bent; a frame without that blood, as of the same buffers, is another."""
    pressed = np.where(np.arange(len(theirs.hand.v_template)) % 3 > 0, 0.0015, 0.0) if is_pressed else None
    shot = replace(kinds()["without lamps"], pressed_m=pressed)
    for renderer in (theirs, drawn[1]):
        renderer.forget()
    expected = drawn[1].render(shot)
    flipped = FLIPPED_OF_LEFT if device.type == "cpu" else FLIPPED
    assert off_by(theirs.render(shot), expected) > 2 * FLIPPED
    assert_same_frame(rendered_at_once(drawn[0], shot), expected, flipped)
    drains = sequence_of(drawn[0])["drains"]
    kept = drains.numpy()
    try:
        drains.zero_()
        assert off_by(rendered_at_once(drawn[0], shot), expected) > 2 * FLIPPED
    finally:
        drains.assign(kept)


def test_the_pipeline_renders_at_once(ours, first, monkeypatch):
    at_once = rendered_at_once(ours, first)
    monkeypatch.setattr(type(ours.pipeline), "gbuffer_of", lambda *_: pytest.fail("rendered stage by stage"))
    frame = ours.render(first)
    assert np.array_equal(frame.rgb, at_once.rgb)
    assert frame.is_lit


def test_frames_through_the_same_buffers_are_as_each_alone(ours, first):
    """Nothing of a frame is left for the next, whatever else it showed."""
    other = replace(first, vertices=first.vertices + np.array([0.004, 0, 0.003]), light=Light((*AREAS, SUN), SKY))
    alone = []
    for shot in (first, other):
        with new_buffers(ours):
            alone.append(rendered_at_once(ours, shot))
    with new_buffers(ours):
        for shot, frame in ((first, alone[0]), (other, alone[1]), (first, alone[0])):
            again = rendered_at_once(ours, shot)
            assert np.array_equal(again.rgb, frame.rgb)
            assert np.array_equal(again.depth, frame.depth)
    assert not np.array_equal(alone[0].rgb, alone[1].rgb)


def test_a_recorded_frame_is_the_plain_one_with_other_parameters(ours, first):
    moved = replace(first, light=Light((*AREAS, SUN), replace(SKY, radiance=2 * SKY.radiance)))
    plain = rendered_at_once(ours, moved)
    rendered_at_once(ours, first)
    buffers = sequence_of(ours)
    graph = buffers.sequence.recorded()
    buffers.sequence.run = lambda: wp.capture_launch(graph)
    try:
        assert np.array_equal(rendered_at_once(ours, moved).rgb, plain.rgb)
    finally:
        del buffers.sequence.run


NETWORKS = 1e-4
"""Sums of 576 products one after another, five times, in single precision; of the largest value."""


def test_networks_are_torchs(ours, first, device):
    """On what a frame gave them; on a GPU in half precision."""
    rendered_at_once(ours, first)
    buffers, (width, height) = sequence_of(ours), sequence_of(ours).shape.size_px
    model, rays = buffers.model, int(buffers["counts"].numpy()[0])
    bound = 2e-3 if device.type == "cuda" else NETWORKS
    inputs = torch.as_tensor(buffers["decoder_inputs"].numpy()[:rays, : model.field.trunk[0].in_features]).float()
    maps = torch.as_tensor(buffers["maps34"].numpy()).T.reshape(1, -1, height, width)
    rows = torch.as_tensor(buffers["tail"].numpy()[: (height + 2) * (width + 2)]).reshape(height + 2, width + 2, -1)
    detail = torch.nn.functional.pixel_shuffle(rows[1:-1, 1:-1, :48].permute(2, 0, 1)[None], 2)
    with torch.no_grad():
        pairs = (
            (torch.as_tensor(buffers["raw"].numpy()[:rays, :30]), model.field.decoded(inputs)),
            (detail, model.superres.residual(maps)),
        )
    for one, other in pairs:
        assert other.abs().max() > 0.1
        assert (one - other).abs().max() < bound * other.abs().max()


def test_launches_of_a_frame(ours, first):
    rendered_at_once(ours, first)
    kernels = sequence_of(ours).sequence.kernels
    assert 40 < len(kernels) <= MOST_LAUNCHES, Counter(kernels)
    rendered_at_once(ours, kinds()["in fine shadows of objects"])
    most = sequence_of(ours, "left").sequence.kernels
    assert len(kernels) < len(most) <= MOST_OF_ANY, Counter(most)


def test_nothing_waits_for_the_host_within_a_frame(ours, first, monkeypatch):
    rendered_at_once(ours, first)
    buffers = sequence_of(ours)

    def forbidden(*_, **__):
        pytest.fail("the host waits")

    for name in ("item", "numpy", "cpu", "tolist", "nonzero", "__bool__", "__int__", "__float__"):
        monkeypatch.setattr(torch.Tensor, name, forbidden)
    for name in ("synchronize", "synchronize_device", "synchronize_stream"):
        monkeypatch.setattr(wp, name, forbidden)
    monkeypatch.setattr(wp.array, "numpy", forbidden)
    buffers.sequence.run()
    monkeypatch.undo()
    assert buffers.answer["overflow"][0] == 0


@pytest.mark.parametrize("list_of", ["layers", "edges"])
def test_a_list_that_overflows_is_said_and_the_stages_take_over(ours, theirs, first, list_of, monkeypatch, caplog):
    if list_of == "layers":
        monkeypatch.setattr(lit_frame, "CAPACITY", 1)
    else:
        monkeypatch.setattr(frame_shape, "EDGE_SHARE", 1e-3)
    with new_buffers(ours), caplog.at_level(logging.WARNING):
        frame = ours.render(first)
    assert "fewer edges or layers" in caplog.text
    theirs.forget()
    assert_same_frame(frame, theirs.render(first))


def test_buffers_of_few_shapes_are_kept(ours):
    with new_buffers(ours):
        check_kept(ours.pipeline._shots._renderer("right"))


def check_kept(frames):
    made = []
    shape = FrameShape((16, 16), 64, 0, 0, 0)
    for lamps in range(6):
        made.append(frames.of(replace(shape, samples=lamps, lamps=lamps)))
    assert len(frames._kept) == 4
    assert frames.of(replace(shape, samples=5, lamps=5)) is made[5]
    assert frames.of(shape) is not made[0]


def test_frames_of_several_threads_are_each_its_own(ours, first):
    shots_of = [replace(first, light=Light((SUN,), replace(SKY, radiance=k * SKY.radiance))) for k in (1.0, 3.0)]
    alone = [rendered_at_once(ours, shot) for shot in shots_of]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda k: rendered_at_once(ours, shots_of[k % 2]), range(3)))
    for k, frame in enumerate(together):
        assert np.array_equal(frame.rgb, alone[k % 2].rgb)


def test_a_full_memory_is_said_and_the_stages_take_over(ours, theirs, first, monkeypatch, caplog):
    def full(*_):
        raise RuntimeError("Failed to allocate 99 bytes on device 'cuda:0'")

    monkeypatch.setattr(lit_frame, "LitFrame", full)
    with new_buffers(ours), caplog.at_level(logging.WARNING):
        frame = ours.render(first)
    assert "memory is full" in caplog.text
    theirs.forget()
    assert_same_frame(frame, theirs.render(first))


def test_what_only_stages_know_is_said(first, hand):
    measured = MeasuredLight(np.zeros((2, 2, 3)), np.zeros((2, 2, 3)), np.ones((2, 2)))
    assert reason_for_stages(first) is None
    assert reason_for_stages(replace(first, light=None)) is None
    assert "measured" in reason_for_stages(replace(first, light=replace(first.light, measured=measured)))
    flat = replace(first.camera, is_orthographic=True)
    assert "orthographic" in reason_for_stages(replace(first, camera=flat))
    avatar = load_avatar()
    assert reason_of_avatar(avatar, hand) is None
    assert "surface" in reason_of_avatar(replace(avatar, surface=None), hand)
    assert reason_of_avatar(replace(avatar, field=BakedField(FieldConfig()), surface=None), hand) is None
    assert "network" in reason_of_avatar(replace(avatar, field=PaperField()), hand)
    assert "enlarges" in reason_of_avatar(replace(avatar, superres=PaperSuperRes(SuperResConfig())), hand)
    assert "vertices" in reason_of_avatar(avatar, replace(hand, v_template=np.zeros((2049, 3))))


def test_measured_light_is_rendered_by_stages_as_the_cpu_does(ours, theirs, first, monkeypatch):
    width, height = first.camera.size_px
    light = np.full((height, width, 3), 0.4)
    shot = replace(
        first, light=replace(first.light, measured=MeasuredLight(light, 0.5 * light, np.ones((height, width))))
    )
    monkeypatch.setattr(LitShots, "render", lambda *_: pytest.fail("rendered at once"))
    theirs.forget()
    assert_same_frame(ours.render(shot), theirs.render(shot))


def test_a_left_hand_has_its_own_marks(ours, hand):
    surface = ours.pipeline._shots.surface
    ratio = AlbedoRatio.of(np.random.default_rng(0).integers(-60, 60, (256, 256, 3), dtype=np.int8))
    marked = LitShots(load_avatar(), hand, WarpBackend("cpu"), surface=replace(surface, left_ratio=ratio))
    assert marked._model("left").maps.ratio is ratio
    assert marked._model("right").maps.ratio is surface.maps.ratio


def test_two_hands_before_each_other_are_composed_as_the_cpus(ours, theirs):
    left = kinds()["left"]
    right = replace(kinds()["right"], light=left.light)
    aside = replace(right, vertices=right.vertices + 0.03 * np.array([1.0, 0.3, 0]))
    pairs = []
    for render in (rendered_at_once, lambda renderer, shot: (renderer.forget(), renderer.render(shot))[1]):
        renderer = ours if render is rendered_at_once else theirs
        pairs.append(joined(visible_parts([render(renderer, shot) for shot in (left, aside)])))
    both, others = pairs
    assert both.alpha.sum() > 1.05 * rendered_at_once(ours, left).alpha.sum()
    assert_same_frame(both, others)
