"""Signed manifests: what is signed is read back and verified, and every change after it is found."""

import argparse
import runpy
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.batch.content_credentials import (
    read_manifest,
    read_signing_key,
    sign_file,
    signing_key,
)
from livehand.backend.records.errors import LiveHandError
from PIL import Image

pytest.importorskip("c2pa")
ORIGIN = {"avatars": [{"name": "mine", "licence": "CC0", "consent": "to all"}]}


@pytest.fixture
def picture(request, tmp_path):
    path = tmp_path / f"picture.{getattr(request, 'param', 'png')}"
    values = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    Image.fromarray(values).save(path)
    return path


@pytest.mark.parametrize("picture", ["png", "jpg"], indirect=True)
def test_a_signed_picture_tells_who_signed_what(picture, signer):
    before = np.asarray(Image.open(picture))
    assert read_manifest(picture) is None
    sign_file(picture, read_signing_key(*signer), ORIGIN)
    manifest = read_manifest(picture)
    assert (manifest.is_valid, manifest.faults) == (True, ())
    assert (manifest.signer, manifest.issuer) == ("Studio", "Test studio")
    assert manifest.origin == ORIGIN
    np.testing.assert_array_equal(np.asarray(Image.open(picture)), before)


def test_a_signed_film_is_verified(tmp_path, signer):
    av = pytest.importorskip("av")
    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(2):
            film.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")))
        film.mux(stream.encode())
    sign_file(path, read_signing_key(*signer), ORIGIN)
    assert read_manifest(path).is_valid
    assert read_manifest(path).origin == ORIGIN


def test_a_change_is_found(picture, signer):
    sign_file(picture, read_signing_key(*signer), ORIGIN)
    data = bytearray(picture.read_bytes())
    data[-100] ^= 1
    picture.write_bytes(data)
    manifest = read_manifest(picture)
    assert not manifest.is_valid
    assert "assertion.dataHash.mismatch" in manifest.faults


def test_what_cannot_be_signed_stays(tmp_path, signer):
    exr, broken = tmp_path / "frame.exr", tmp_path / "broken.png"
    for path in (exr, broken):
        path.write_bytes(b"no picture")
    with pytest.raises(LiveHandError, match=r"one of \.png, \.jpg, \.jpeg, \.mp4, got frame\.exr"):
        sign_file(exr, read_signing_key(*signer), ORIGIN)
    with pytest.raises(LiveHandError, match=r"broken\.png could not be signed"):
        sign_file(broken, read_signing_key(*signer), ORIGIN)
    assert broken.read_bytes() == b"no picture"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.png", "frame.exr"]


def test_keys_that_cannot_sign_are_named(tmp_path, signer):
    certificates = runpy.run_path(str(Path(__file__).parents[1] / "certificates.py"))
    certificate, key = signer
    text = tmp_path / "text.pem"
    text.write_bytes(b"no key")
    with pytest.raises(LiveHandError, match=r"text\.pem must be a PEM private key without a password"):
        read_signing_key(certificate, text)
    with pytest.raises(LiveHandError, match=r"text\.pem must be a PEM chain for C2PA"):
        read_signing_key(text, key)
    others = certificates["write_signer"](tmp_path)[1]
    with pytest.raises(LiveHandError, match=r"key\.pem; got"):
        read_signing_key(certificate, others)
    with pytest.raises(LiveHandError, match="both --certificate and --private-key, got one"):
        signing_key(argparse.Namespace(certificate=certificate, private_key=None))
    assert signing_key(argparse.Namespace(certificate=None, private_key=None)) is None
