"""OpenEXR of captures against Blender's own: it reads what we write, and we read what it saves."""

import bpy
import numpy as np
import pytest
from livehand.backend.capture.exr import read_exr, write_exr
from livehand.backend.records.errors import LiveHandError

HEIGHT, WIDTH = 37, 21
PIXELS = np.random.default_rng(0).uniform(0, 9, (HEIGHT, WIDTH, 4)).astype(np.float16).astype(np.float32)


def saved(path, depth, codec):
    """The pixels as Blender saves an image in these settings."""
    image = bpy.data.images.new("picture", WIDTH, HEIGHT, float_buffer=True, alpha=True)
    image.colorspace_settings.name = "Linear Rec.709"
    image.alpha_mode = "PREMUL"
    image.pixels.foreach_set(PIXELS[::-1].ravel())
    image.update()
    settings = bpy.context.scene.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGBA"
    settings.color_depth, settings.exr_codec = depth, codec
    image.save_render(str(path), scene=bpy.context.scene)
    return path


@pytest.mark.parametrize("depth", ["16", "32"])
@pytest.mark.parametrize("codec", ["NONE", "ZIP", "ZIPS"])
def test_what_blender_saves_is_read(tmp_path, depth, codec):
    bpy.context.scene.view_settings.view_transform = "Standard"
    channels = read_exr(saved(tmp_path / "a.exr", depth, codec))
    assert {channel.dtype for channel in channels.values()} == {np.dtype(f"float{depth}")}
    picture = np.stack([channels[name] for name in "RGBA"], -1)
    np.testing.assert_allclose(picture[..., :3], PIXELS[..., :3], rtol=1e-3)


def test_other_compressions_of_blender_are_named(tmp_path):
    with pytest.raises(LiveHandError, match="its compression is PIZ; save it with ZIP"):
        read_exr(saved(tmp_path / "a.exr", "16", "PIZ"))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_blender_reads_what_we_write(tmp_path, dtype):
    path = tmp_path / "a.exr"
    write_exr(path, {name: PIXELS[..., k].astype(dtype) for k, name in enumerate("RGBA")})
    image = bpy.data.images.load(str(path))
    image.alpha_mode = "CHANNEL_PACKED"
    assert tuple(image.size) == (WIDTH, HEIGHT)
    back = np.empty(4 * WIDTH * HEIGHT, np.float32)
    image.pixels.foreach_get(back)
    np.testing.assert_allclose(back.reshape(HEIGHT, WIDTH, 4)[::-1], PIXELS, rtol=1e-6)
