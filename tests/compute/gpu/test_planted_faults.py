"""Faults planted in whole frames: each is seen by what compares them with the CPU's, or with the same frame alone."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from livehand.backend.compute.gpu import lit_frame
from livehand.backend.compute.gpu.frame_shape import FrameShape

from .conftest import POINT, SKY, SUN
from .whole_frames import FLIPPED_OF_LEFT, assert_same_frame, kinds, new_buffers, rendered_at_once, sequence_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shot():
    """With all that a frame may have, and few samples of lamps."""
    of_objects = kinds()["in fine shadows of objects"]
    return replace(of_objects, light=replace(of_objects.light, lamps=(POINT, SUN), shadow_quality="coarse"))


@pytest.fixture(scope="module")
def expected(device, theirs, shot):
    if device.type != "cpu":
        pytest.skip("what a fault changes is no other on a GPU")
    theirs.forget()
    return theirs.render(shot)


def is_the_cpus(frame, expected):
    try:
        assert_same_frame(frame, expected, FLIPPED_OF_LEFT)
    except AssertionError:
        return False
    return True


def test_without_a_fault_nothing_is_seen(ours, shot, expected):
    assert is_the_cpus(rendered_at_once(ours, shot), expected)


def after(buffers, kernel, fault):
    """The steps of a sequence with a fault after the last launch of a kernel."""
    steps, launches = [], 0
    last = len(buffers.sequence.kernels) - 1 - buffers.sequence.kernels[::-1].index(kernel)
    for step in buffers.sequence._steps:
        steps.append(step)
        if getattr(step, "__self__", None) is not None and isinstance(step.__self__, wp.Launch):
            if launches == last:
                steps.append(fault)
            launches += 1
    assert len(steps) == len(buffers.sequence._steps) + 1
    return steps


def scaled(name, factor):
    def plant(buffers):
        values = buffers[name].numpy()
        buffers[name].assign(values * np.float32(factor))

    return plant


WRONG = {
    "a pose": ("raised_vertices", scaled("fine", 1.01)),
    "a depth of shadows": ("look_up", scaled("depth_in_m", 3.0)),
    "shadows": ("look_up", scaled("lit", 0.8)),
    "the sky that the hand leaves open": ("look_up", scaled("alone", 0.5)),
    "what the field gathers": ("sum_samples", scaled("channels", 1.05)),
    "a decoder": ("decode_rays", scaled("low", 1.05)),
    "light of surfels": ("reflect_on_surfels", scaled("radiance_of_surfels", 3.0)),
    "light of patches": ("share_among_patches", scaled("emitted", 1.5)),
    "smoothed light": ("mean_over_surface", scaled("smooth_light", 1.05)),
    "super-resolution": ("multiply_rows_plainly", scaled("tail", 1.5)),
    "shares of rays": ("ray_shares", scaled("shares", 0.9)),
    "a normal": ("add_skin", scaled("bump_normal", -1.0)),
    "colours": ("relit_pixels", scaled("colours", 1.03)),
    "hairs": ("pose_hairs", scaled("hair_placed", 1.02)),
}


BY_DAY = "a pose", "the sky that the hand leaves open", "a decoder", "light of patches", "hairs"


@pytest.mark.parametrize(
    "what", [what if what in BY_DAY else pytest.param(what, marks=pytest.mark.nightly) for what in WRONG]
)
def test_a_wrong_value_of_a_kernel_is_seen(ours, shot, expected, what, monkeypatch):
    rendered_at_once(ours, shot)
    buffers = sequence_of(ours, "left")
    kernel, plant = WRONG[what]
    monkeypatch.setattr(buffers.sequence, "_steps", after(buffers, kernel, lambda: plant(buffers)))
    assert not is_the_cpus(rendered_at_once(ours, shot), expected)


def test_a_lost_lamp_is_seen(ours, shot, expected, monkeypatch):
    fill = lit_frame.fill_parameters

    def without_a_lamp(host, *given):
        fill(host, *given)
        host["lamp_rgb"][1] = 0

    monkeypatch.setattr(lit_frame, "fill_parameters", without_a_lamp)
    assert not is_the_cpus(rendered_at_once(ours, shot), expected)


@pytest.mark.parametrize(
    "name",
    [
        "flux",
        *(
            pytest.param(name, marks=pytest.mark.nightly)
            for name in ("radiance", "occluders", "patch_albedo", "hair_count")
        ),
    ],
)
def test_a_parameter_that_is_not_uploaded_anew_is_seen(ours, theirs, shot, expected, name, monkeypatch):
    """A frame, and then another through the same buffers."""
    rendered_at_once(ours, shot)
    sky, objects = replace(SKY, radiance=2 * SKY.radiance), shot.light.occluders + 0.02
    light = replace(shot.light, sky=sky, occluders=objects, occluder_albedo=1 - shot.light.occluder_albedo)
    other = replace(shot, light=light, hair=0.3)
    kept = sequence_of(ours, "left").host[name].copy()
    theirs.forget()
    of_other = theirs.render(other)
    assert not is_the_cpus(of_other, expected)
    assert is_the_cpus(rendered_at_once(ours, other), of_other)
    fill = lit_frame.fill_parameters

    def without_one(host, *given):
        fill(host, *given)
        host[name][:] = kept

    monkeypatch.setattr(lit_frame, "fill_parameters", without_one)
    assert not is_the_cpus(rendered_at_once(ours, other), of_other)


def test_an_overflow_that_is_not_said_is_seen(ours, shot, expected, monkeypatch):
    monkeypatch.setattr(lit_frame, "CAPACITY", 1)
    with new_buffers(ours):
        assert ours.pipeline._shots.render(shot) is None
        buffers = sequence_of(ours, "left")
        monkeypatch.setattr(buffers.sequence, "_steps", [*buffers.sequence._steps, lambda: buffers["overflow"].zero_()])
        buffers.sequence.then(buffers.answer.download)
        assert not is_the_cpus(rendered_at_once(ours, shot), expected)


def test_frames_of_another_shape_through_the_first_ones_buffers_are_seen(ours, shot, expected, monkeypatch):
    assert is_the_cpus(rendered_at_once(ours, shot), expected)
    first = FrameShape.of
    monkeypatch.setattr(FrameShape, "of", lambda shot: replace(first(shot), has_hairs=False))
    assert not is_the_cpus(rendered_at_once(ours, shot), expected)
    monkeypatch.setattr(FrameShape, "of", first)
    assert is_the_cpus(rendered_at_once(ours, shot), expected)


CONSTANT = {"light", "decoder_inputs"}
"""The columns of `arriving` are ones from the beginning, and those by which inputs are padded zeros."""


def poison(buffers, constant=CONSTANT):
    """Fill all that a frame is to fill before it is read."""
    for name in buffers.filled:
        if name not in constant and buffers[name].size:
            kind = buffers[name].dtype
            is_whole = kind in (wp.int32, wp.int64, wp.bool)
            buffers[name].fill_(1 if is_whole else float("nan"))


@pytest.mark.parametrize("kind", ["in fine shadows of objects", "without lamps"])
def test_poisoned_buffers_change_no_frame(ours, kind):
    """What a launch reads, a launch of the same frame has filled."""
    shot = kinds()[kind]
    clean = rendered_at_once(ours, shot)
    buffers = sequence_of(ours, shot.pose.side)
    poison(buffers)
    again = rendered_at_once(ours, shot)
    assert np.array_equal(again.rgb, clean.rgb)
    assert np.array_equal(again.alpha, clean.alpha)
    assert np.array_equal(again.depth, clean.depth)


@pytest.mark.usefixtures("expected")
def test_a_launch_that_reads_what_is_not_filled_is_seen(ours, shot, monkeypatch):
    clean = rendered_at_once(ours, shot)
    buffers = sequence_of(ours, "left")
    skipped = [step for step in buffers.sequence._steps if isinstance(getattr(step, "__self__", None), wp.Launch)]
    lost = skipped[buffers.sequence.kernels.index("sky_features")]
    monkeypatch.setattr(buffers.sequence, "_steps", [step for step in buffers.sequence._steps if step != lost])
    poison(buffers)
    assert not np.array_equal(rendered_at_once(ours, shot).rgb, clean.rgb)
