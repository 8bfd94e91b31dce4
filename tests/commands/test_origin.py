"""`livehand origin` and `livehand sign`: avatars are told by their watermarks, metadata and signatures."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.origin import joint_payload, read_origin
from livehand.backend.commands.origin import origin_text
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.image.frame_writer import FileWriter
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.image.watermark.embedding import watermarked
from livehand.backend.records.frame import Frame
from livehand.livehand_blender.cli import main
from PIL import Image

pytestmark = pytest.mark.slow

LIGHT, DEEP = (read_origin(shipped_avatar_path(skin)) for skin in ("light", "deep"))


@pytest.fixture
def write(tmp_path):
    """A function: a frame of textured skin, with the watermark of these avatars, and with their metadata if wanted."""

    def write(origins, has_text=False):
        rng = np.random.default_rng(0)
        alpha = np.zeros((256, 256), np.float32)
        alpha[16:240, 16:240] = 1
        rgb = (0.3 + 0.02 * rng.normal(size=(256, 256, 1))) * np.array([1, 0.7, 0.5]) * alpha[..., None]
        rgb = watermarked(rgb.astype(np.float32), alpha, joint_payload(one.payload for one in origins))
        with FileWriter() as writer:
            frame = Frame(rgb, alpha, alpha)
            writer.write(frame, tmp_path / "frame.png", text=origin_text(origins) if has_text else None)
        return tmp_path / "frame.png"

    return write


@pytest.fixture
def told(capsys):
    """A function: what the command reports of a file."""

    def told(*arguments):
        capsys.readouterr()
        assert main(["origin", *map(str, arguments), "--json"]) == 0
        return json.loads(capsys.readouterr().out.splitlines()[-1])

    return told


@pytest.fixture
def tiny_avatar(tmp_path):
    """The path of an untrained avatar in a folder of its own, and a function that saves it there with changes."""
    path = tmp_path / "avatars" / "tiny.safetensors"
    path.parent.mkdir()
    field = FieldConfig(width=4, planes=((8, 2, 2),), relief=8)
    config = AvatarConfig(field, SuperResConfig(width=4, depth=1), SamplerConfig())

    def save(seed=0, licence="CC0", fine_tuned=False, **changes):
        facts = {"consent": "to this test"}
        provenance = {"fine_tuned_from": {"provenance": facts}} if fine_tuned else facts
        avatar = new_avatar("tiny", "hand", "0" * 64, config, seed)
        save_avatar(replace(avatar, provenance={**provenance, "licence": licence}, **changes), path)
        return path

    return save(), save


def test_a_marked_avatar_tells_its_bits(tiny_avatar, told, tmp_path, capsys):
    path, _ = tiny_avatar
    bits = read_origin(path).payload.hex()
    assert told(path)["marks_frames"] is False
    out = tmp_path / "marked.safetensors"
    assert main(["watermark", str(path), "-o", str(out)]) == 0
    facts = told(out)
    assert (facts["bits"], facts["marks_frames"], facts["albedo"]) == (bits, True, None)
    assert main(["watermark", str(out), "-o", str(path)]) == 1
    assert "not be marked yet" in capsys.readouterr().err


@pytest.mark.parametrize("origins", [(DEEP,), (LIGHT, DEEP)], ids=["one", "two"])
def test_avatars_are_told_by_the_watermark_alone(write, told, origins):
    facts = told(write(origins), "--scale", 1)
    assert (facts["watermark"], facts["matching_bits"], facts["scale"]) == (True, 64, 1.0)
    assert facts["bits"] == joint_payload(one.payload for one in origins).hex()
    assert [one["name"] for one in facts["avatars"]] == [one.name for one in origins]
    assert facts["metadata"] == {}
    assert facts["signature"] in (None, "not read: it needs the package c2pa-python")


def test_a_picture_of_somebody_else_names_nobody(write, told, tmp_path):
    stranger = type(DEEP)("stranger", "", "", b"someone.")
    facts = told(write((stranger,)), "--scale", 1)
    assert (facts["watermark"], facts["bits"]) == (True, b"someone.".hex())
    assert "avatars" not in facts
    Image.fromarray(np.full((256, 256, 3), 90, np.uint8)).save(tmp_path / "plain.png")
    facts = told(tmp_path / "plain.png", "--scale", 1)
    assert facts["watermark"] is False
    assert "bits" not in facts


def test_own_avatars_are_compared_too(write, told, tmp_path, tiny_avatar):
    path, _ = tiny_avatar
    own = read_origin(path)
    facts = told(write((own,)), "--avatar", path.parent, "--scale", 1)
    assert facts["avatars"] == [{"name": own.name, "licence": own.licence, "consent": own.consent}]


def test_the_origin_of_an_avatar_follows_its_weights_and_licence_alone(tiny_avatar):
    path, save = tiny_avatar
    before = read_origin(path)
    assert (before.licence, before.consent) == ("CC0", "to this test")
    assert read_origin(save(metrics={"note": {}})).payload == before.payload
    assert read_origin(save(thumbnail=np.zeros((4, 4, 4), np.uint8))).payload == before.payload
    assert read_origin(save(licence="CC-BY-4.0")).payload != before.payload
    assert read_origin(save(seed=1)).payload != before.payload
    assert read_origin(save(fine_tuned=True)).consent == "to this test"


def test_a_frame_tells_its_avatar_to_who_signs_it(write, told, signer):
    pytest.importorskip("c2pa")
    certificate, key = map(str, signer)
    path = write((DEEP,), has_text=True)
    assert main(["sign", str(path), "--certificate", certificate, "--private-key", key]) == 0
    facts = told(path, "--scale", 1)
    assert facts["metadata"] == {"LiveHand/Avatar": "deep", "LiveHand/License": "GPL-3.0-or-later"}
    assert facts["signature"]["valid"] is True
    assert facts["signature"]["origin"]["avatars"] == facts["avatars"]


def test_the_record_beside_a_frame_tells_too_and_else_nothing_is_signed(write, signer, told, capsys):
    pytest.importorskip("c2pa")
    arguments = [str(write((DEEP,))), "--certificate", str(signer[0]), "--private-key", str(signer[1])]
    before = write((DEEP,)).read_bytes()
    assert main(["sign", *arguments]) == 1
    assert "does not tell which avatar it shows; name it with --avatar" in capsys.readouterr().err
    assert write((DEEP,)).read_bytes() == before
    avatar = {"name": "mine", "licence": "CC0", "consent": "to all", "sha256": "12"}
    write((DEEP,)).with_suffix(".json").write_text(json.dumps({"formats": ["png"], "hands": [{"avatar": avatar}]}))
    assert main(["sign", *arguments]) == 0
    shown = {"name": "mine", "licence": "CC0", "consent": "to all"}
    assert told(arguments[0], "--scale", 1)["signature"]["origin"] == {"avatars": [shown]}
    assert main(["sign", *arguments, "--avatar", "light"]) == 0
    assert told(arguments[0], "--scale", 1)["signature"]["origin"]["avatars"][0]["name"] == "light"
