"""Frames whose memory is taken again: as fresh ones, and never while anybody holds one."""

import numpy as np
import pytest
from livehand.backend.compute.whole_frames import ShotPixels
from livehand.backend.image.crop import Crop
from livehand.backend.image.kept_images import KeptImages
from livehand.backend.records.frame import DEPTH_BACKGROUND, empty_frame

SIZE_PX = 40, 30
CROPS = [Crop(*place, 8, 6) for place in ((-3, -2), (4, 5), (16, 11), (6, 4), (4, 5), (30, 30), (0, 0))]


def pixels_of(number):
    rng = np.random.default_rng(number)
    shapes = (12, 16, 3), (12, 16), (12, 16)
    return ShotPixels(*(rng.random(shape, np.float32) for shape in shapes))


def fresh(pixels, crop):
    frame = empty_frame(SIZE_PX)
    for values, image in zip(pixels, (frame.rgb, frame.alpha, frame.depth), strict=True):
        crop.paste(values, image)
    return frame


def arrays_of(frame):
    return frame.rgb, frame.alpha, frame.depth


def test_a_frame_in_kept_memory_is_the_fresh_one():
    images, places = KeptImages(), set()
    for number, crop in enumerate(CROPS):
        frame = images.frame(pixels_of(number), crop, SIZE_PX, is_lit=True)
        for one, other in zip(arrays_of(frame), arrays_of(fresh(pixels_of(number), crop)), strict=True):
            np.testing.assert_array_equal(one, other)
        places.add(frame.rgb.ctypes.data)
        del frame, one
    assert len(places) == 1


@pytest.mark.parametrize(
    "hold", [lambda frame: frame, lambda frame: frame.depth[3:, 2:], lambda frame: memoryview(frame.alpha)]
)
def test_memory_that_is_held_is_not_written(hold):
    images, crop = KeptImages(), CROPS[1]
    held = hold(images.frame(pixels_of(0), crop, SIZE_PX, is_lit=True))
    before = [np.array(one) for one in (arrays_of(held) if hasattr(held, "rgb") else [held])]
    others = [images.frame(pixels_of(number), crop, SIZE_PX, is_lit=True) for number in (1, 2)]
    now = arrays_of(held) if hasattr(held, "rgb") else [held]
    for one, other in zip(before, now, strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.shares_memory(others[0].rgb, others[1].rgb)


def test_nobody_can_write_a_frame():
    frame = KeptImages().frame(pixels_of(0), CROPS[0], SIZE_PX, is_lit=False)
    assert not frame.is_lit
    for array in arrays_of(frame):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_memory_of_another_size_and_beyond_the_limit_is_left():
    images = KeptImages(2 * 40 * 30 * 20)
    held = [images.frame(pixels_of(0), CROPS[0], SIZE_PX, is_lit=True) for _ in range(4)]
    assert len({frame.rgb.ctypes.data for frame in held}) == 4
    assert len(images._kept) == 2
    wide = images.frame(pixels_of(0), CROPS[0], (60, 30), is_lit=True)
    assert wide.depth.shape == (30, 60)
    assert wide.depth[-1, -1] == np.float32(DEPTH_BACKGROUND)
    assert [one.size_px for one in images._kept] == [(60, 30)]
