"""Frames of Blender tell their avatar: by a watermark, by metadata, and signed."""

import json

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.origin import read_origin
from livehand.backend.batch.content_credentials import read_manifest
from livehand.backend.image.watermark.detection import read_watermark
from livehand.livehand_blender import cli
from PIL import Image

SHOWN = {"LiveHand/Avatar": "fake", "LiveHand/License": "CC0", "LiveHand/Consent": "to all"}
PAYLOAD = read_origin(shipped_avatar_path()).payload


@pytest.fixture
def render(shot_path, tmp_path, fake_session):
    """A function: the first frame by `livehand render`, uint8 [256, 256, 3] on black, and its path."""

    def render(*options, folder="out"):
        arguments = [str(shot_path), "-o", str(tmp_path / folder), "--frames", "1", "--size", "256x256"]
        assert cli.main(["render", *arguments, "--format", "exr,png", *map(str, options)]) == 0
        path = tmp_path / folder / "wave_0001.png"
        pixels = np.asarray(Image.open(path), np.float32)
        return (pixels[..., :3] * (pixels[..., 3:] / 255)).round().astype(np.uint8), path

    return render


def test_a_watermark_is_written_if_it_is_asked_for(render, hand_scene, shot_path):
    plain, path = render()
    assert read_watermark(plain, (1.0,)).agreement(PAYLOAD) < 52
    marked, other = render("--watermark", folder="marked")
    reading = read_watermark(marked, (1.0,))
    assert reading.is_sure
    assert reading.agreement(PAYLOAD) == 64
    settings = [json.loads(one.with_suffix(".json").read_text())["version"]["settings"] for one in (path, other)]
    assert [one.get("watermark") for one in settings] == [None, "on"]
    bpy.ops.wm.open_mainfile(filepath=str(shot_path))
    bpy.context.scene.livehand.watermark = True
    bpy.ops.wm.save_mainfile()
    again, _ = render(folder="again")
    np.testing.assert_array_equal(again, marked)


def test_frames_tell_avatar_licence_and_consent(render):
    _, path = render()
    with Image.open(path) as picture:
        picture.load()
        assert {key: picture.info.get(key) for key in SHOWN} == SHOWN
    exr = path.with_suffix(".exr").read_bytes()
    assert all(f"{key}\0string\0".encode() in exr and value.encode() in exr for key, value in SHOWN.items())


def test_pngs_are_signed(render, signer, shot_path, tmp_path, capsys):
    pytest.importorskip("c2pa")
    keys = ["--certificate", str(signer[0]), "--private-key", str(signer[1])]
    manifest = read_manifest(render(*keys)[1])
    assert manifest.is_valid
    assert manifest.origin == {"avatars": [{"name": "fake", "licence": "CC0", "consent": "to all"}]}
    assert cli.main(["render", str(shot_path), "-o", str(tmp_path / "exr"), *keys]) == 1
    assert "signed frames must be PNGs" in capsys.readouterr().err
