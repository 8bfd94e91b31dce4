"""Avatar files: round trips, and the refusal of everything but a complete avatar."""

import json
import pickle
import struct
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.avatars import file as avatar_module
from livehand.backend.avatars.avatar import PRESETS, Avatar, AvatarConfig, new_avatar
from livehand.backend.avatars.file import VERSION, load_avatar, read_header, save_avatar
from livehand.backend.avatars.library import SHIPPED, SKINS, avatar_path, shipped_avatar_path, shipped_skin
from livehand.backend.avatars.tensors import stored_weights, whole_weights
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.model_file import builtin_sha256
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Sky
from safetensors.torch import load_file, save_file

SMALL = AvatarConfig(
    FieldConfig(width=4, planes=((8, 2, 2),), relief=8),
    SuperResConfig(width=4, depth=1),
    SamplerConfig(samples_per_ray=3, shell_m=0.002),
)


@pytest.fixture
def avatar():
    made = new_avatar("ada", "hand", "ab" * 32, SMALL)
    return replace(made, provenance={"licence": "CC0", "steps": 3}, metrics={"psnr_full": 31.5})


@pytest.fixture
def path(avatar, tmp_path):
    save_avatar(avatar, tmp_path / "ada.safetensors")
    return tmp_path / "ada.safetensors"


def states(avatar: Avatar):
    return {**avatar.field.state_dict(), **{f"s.{k}": v for k, v in avatar.superres.state_dict().items()}}


@pytest.mark.parametrize("config", [SMALL, PRESETS["paper"]], ids=["planes", "paper"])
def test_round_trip(tmp_path, config):
    made = new_avatar("ada", "hand", "ab" * 32, config, seed=4)
    save_avatar(made, tmp_path / "a.safetensors")
    back = load_avatar(tmp_path / "a.safetensors")
    for name in ("name", "hand_name", "hand_sha256", "config", "provenance", "metrics"):
        assert getattr(back, name) == getattr(made, name)
    weights, expected = states(back), states(made)
    assert weights.keys() == expected.keys()
    for key, value in expected.items():
        torch.testing.assert_close(weights[key], value.half().float(), rtol=0, atol=0)
    save_avatar(back, tmp_path / "b.safetensors")
    assert (tmp_path / "b.safetensors").read_bytes() == (tmp_path / "a.safetensors").read_bytes()


def test_the_header_describes_the_avatar(avatar, path):
    header = read_header(path)
    assert header["format_version"] == VERSION
    assert header["provenance"] == avatar.provenance
    assert header["metrics"] == avatar.metrics
    assert header["config"]["sampler"] == asdict(SMALL.sampler)


def test_it_is_half_precision_and_no_pickle(path):
    assert {value.dtype for value in load_file(path).values()} == {torch.float16}
    assert path.stat().st_size < 40_000
    with pytest.raises(pickle.UnpicklingError):
        pickle.loads(path.read_bytes())


def test_the_seed_determines_the_weights_and_the_global_random_state_is_kept():
    torch.manual_seed(1)
    expected = torch.rand(3)
    torch.manual_seed(1)
    one, again, other = (new_avatar("a", "h", "0", SMALL, seed) for seed in (5, 5, 6))
    assert torch.equal(torch.rand(3), expected)
    assert torch.equal(one.field.planes[0].table, again.field.planes[0].table)
    assert not torch.equal(one.field.planes[0].table, other.field.planes[0].table)


def test_a_failed_save_leaves_the_older_file_and_no_other(avatar, path, monkeypatch):
    before = path.read_bytes()
    monkeypatch.setattr(avatar_module, "save", lambda *_, **__: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(LiveHandError, match=r"ada\.safetensors must be writable \(disk full"):
        save_avatar(replace(avatar, name="bob"), path)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["ada.safetensors"]


def test_truncated_files_are_refused(path):
    data = path.read_bytes()
    for size in (0, 4, 8, 100, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:size])
        with pytest.raises(LiveHandError, match="cut short"):
            load_avatar(path)


def test_an_altered_byte_is_refused_anywhere(path):
    """In the length, the text of the header, and the weights: each is refused with a LiveHandError."""
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    header_end = 8 + struct.unpack("<Q", data[:8])[0]
    spots = [*range(8), *rng.integers(8, header_end, 150), *rng.integers(header_end, len(data), 20), len(data) - 1]
    unnoticed = []
    for spot in map(int, spots):
        altered = bytearray(data)
        altered[spot] ^= 1 << int(rng.integers(0, 7))
        path.write_bytes(bytes(altered))
        try:
            unnoticed.append((spot, load_avatar(path).config))
        except LiveHandError:
            continue
    # The blanks that pad the header may change without changing the avatar.
    assert [spot for spot, config in unnoticed if data[spot] != ord(" ") or config != SMALL] == []


def rewritten(path, change):
    """The file with its JSON entry changed, checksum and all else kept."""
    tensors = load_file(path)
    data = path.read_bytes()
    outer = json.loads(data[8 : 8 + struct.unpack("<Q", data[:8])[0]])["__metadata__"]
    header = json.loads(outer["livehand"])
    change(header)
    save_file(tensors, path, metadata={"livehand": json.dumps(header)})


def signed_anew(path, change):
    """The file with its JSON entry changed, and the checksum that this makes right."""

    def change_and_sign(header):
        change(header)
        header.pop("checksum")
        header["checksum"] = avatar_module._checksum(header, load_file(path))

    rewritten(path, change_and_sign)


@pytest.mark.parametrize(
    ("key", "value"),
    [("name", "eve"), ("hand_sha256", "cd" * 32), ("provenance", {}), ("metrics", {"psnr_full": 99.0})],
)
def test_an_altered_header_is_refused(path, key, value):
    rewritten(path, lambda header: header.update({key: value}))
    with pytest.raises(LiveHandError, match="altered or damaged"):
        load_avatar(path)


def test_an_altered_configuration_is_refused(path):
    rewritten(path, lambda header: header["config"]["sampler"].update(shell_m=0.5))
    with pytest.raises(LiveHandError, match="altered or damaged"):
        read_header(path)


def test_a_newer_version_is_refused(path):
    rewritten(path, lambda header: header.update(format_version=VERSION + 1))
    with pytest.raises(LiveHandError, match=f"format 1 to {VERSION}, got {VERSION + 1}; update LiveHand"):
        load_avatar(path)


class Bomb:
    def __reduce__(self):
        return (exec, ("raise SystemExit('it was run')",))


@pytest.mark.parametrize("protocol", [0, 4])
def test_a_pickle_is_never_run(tmp_path, protocol):
    path = tmp_path / "evil.safetensors"
    path.write_bytes(pickle.dumps(Bomb(), protocol))
    with pytest.raises(LiveHandError, match=r"must be a \.safetensors avatar"):
        load_avatar(path)
    torch.save({"weights": torch.ones(3)}, path)
    with pytest.raises(LiveHandError, match=r"must be a \.safetensors avatar"):
        load_avatar(path)


def test_another_safetensors_file_is_refused(tmp_path):
    path = tmp_path / "unet.safetensors"
    for metadata in (None, {"format": "pt"}):
        save_file({"weight": torch.ones(3)}, path, metadata=metadata)
        with pytest.raises(LiveHandError, match="something else"):
            load_avatar(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(LiveHandError, match=r"no avatar at .*gone\.safetensors"):
        load_avatar(tmp_path / "gone.safetensors")


def test_weights_that_do_not_fit_their_configuration_are_refused(avatar, path):
    """With a correct checksum: written by a faulty program."""
    save_avatar(replace(avatar, config=replace(SMALL, field=FieldConfig(width=8, planes=((8, 2, 2),), relief=8))), path)
    with pytest.raises(LiveHandError, match="must fit the configuration"):
        load_avatar(path)


@pytest.mark.parametrize("damage", [lambda c: c["field"].update(colour="red"), lambda c: c.pop("sampler")])
def test_a_configuration_of_another_version_is_refused(avatar, path, monkeypatch, damage):
    def foreign(config):
        values = asdict(config)
        damage(values)
        return values

    monkeypatch.setattr(avatar_module, "asdict", foreign)
    save_avatar(avatar, path)
    with pytest.raises(LiveHandError, match="must be this version's"):
        load_avatar(path)


@pytest.mark.parametrize("skin", SKINS)
def test_shipped_avatars_are_of_the_built_in_hand_and_small(skin):
    path = shipped_avatar_path(skin)
    assert load_avatar(path).hand_sha256 == builtin_sha256()
    assert path.stat().st_size <= 6e6


def test_an_avatar_that_shipped_is_known_by_its_place(tmp_path):
    assert [shipped_skin(shipped_avatar_path(name)) for name in SHIPPED] == list(SHIPPED)
    assert shipped_skin(tmp_path / "light.safetensors") is None
    assert shipped_skin(shipped_avatar_path().with_name("other.safetensors")) is None


@pytest.mark.slow
def test_other_names_are_paths():
    assert avatar_path("mine.safetensors") == Path("mine.safetensors")
    assert load_avatar().provenance == load_avatar(avatar_path("light")).provenance


LIT = replace(SMALL, field=replace(SMALL.field, light="linear"), superres=SuperResConfig(kind="lit", width=4, depth=1))


def test_a_relightable_avatar_keeps_the_sky_of_its_capture(tmp_path):
    radiance = np.random.default_rng(0).uniform(0, 3, (4, 8, 3)).astype(np.float16).astype(np.float32)
    made = replace(new_avatar("ada", "hand", "ab" * 32, LIT), sky=Sky(radiance))
    save_avatar(made, tmp_path / "a.safetensors")
    back = load_avatar(tmp_path / "a.safetensors")
    assert back.config == LIT
    assert np.array_equal(back.sky.radiance, radiance)


def test_files_of_earlier_versions_are_read(avatar, path):
    """Version 1 was written without the field's light, which was baked in."""

    def earlier(header):
        header["format_version"] = 1
        del header["config"]["field"]["light"]

    signed_anew(path, earlier)
    assert read_header(path)["format_version"] == 1
    back = load_avatar(path)
    assert (back.config, back.surface, back.sky) == (SMALL, None, None)
    assert states(back).keys() == states(avatar).keys()


def test_planes_of_a_relightable_avatar_are_bytes_of_a_scale_a_channel(tmp_path):
    made = new_avatar("ada", "hand", "ab" * 32, LIT, seed=3)
    with torch.no_grad():
        made.field.planes[0].table[:, 1] = 0
        made.field.planes[0].table[:, 0] *= 100
    save_avatar(made, tmp_path / "a.safetensors")
    stored, expected = load_file(tmp_path / "a.safetensors"), states(made)
    tables = {key for key in expected if key.endswith(".table")}
    assert {key for key, value in stored.items() if value.dtype == torch.int8} == {f"field.{key}" for key in tables}
    back = load_avatar(tmp_path / "a.safetensors")
    for key, value in states(back).items():
        if key not in tables:
            assert torch.equal(value, expected[key].half().float())
            continue
        largest = expected[key].abs().amax(0)
        off = (value - expected[key]).abs().amax(0)
        assert (off <= 1.001 * largest / 254).all()
        assert (off[largest > 0] > 0.9 * largest[largest > 0] / 254).all()
    assert (back.field.planes[0].table[:, 1] == 0).all()
    save_avatar(back, tmp_path / "b.safetensors")
    assert (tmp_path / "b.safetensors").read_bytes() == (tmp_path / "a.safetensors").read_bytes()


def test_planes_that_are_read_are_written_as_they_were(tmp_path):
    """In whichever steps: a 127th of 127 steps is a step again."""
    table = torch.randn(40, 4096, generator=torch.Generator().manual_seed(0)) * torch.logspace(-6, 3, 4096)
    once = stored_weights({"a.table": table}, has_byte_planes=True)
    again = stored_weights(whole_weights(once, tmp_path), has_byte_planes=True)
    for name, values in once.items():
        assert torch.equal(values, again[name])


def without_scale(tensors):
    del tensors["field.planes.0.table.scale"]


def of_other_channels(tensors):
    tensors["field.planes.0.table.scale"] = torch.ones(3)


def of_half(tensors):
    tensors["field.planes.0.table.scale"] = tensors["field.planes.0.table.scale"].half()


@pytest.mark.parametrize("break_it", [without_scale, of_other_channels, of_half])
def test_planes_without_their_scale_are_refused(tmp_path, break_it):
    path = tmp_path / "a.safetensors"
    save_avatar(new_avatar("ada", "hand", "ab" * 32, LIT), path)
    header, tensors = read_header(path), load_file(path)
    break_it(tensors)
    header["checksum"] = avatar_module._checksum(header, tensors)
    save_file(tensors, path, metadata={"livehand": json.dumps(header)})
    with pytest.raises(LiveHandError, match=r"field\.planes\.0\.table .* must have a scale of float32 for each"):
        load_avatar(path)


@pytest.mark.parametrize("value", [torch.nan, torch.inf])
@pytest.mark.parametrize("config", [SMALL, LIT], ids=["baked", "relightable"])
def test_weights_that_are_not_finite_are_refused(tmp_path, config, value):
    """With a right checksum; such an avatar would render empty frames."""
    avatar, path = new_avatar("ada", "hand", "ab" * 32, config), tmp_path / "ada.safetensors"
    with torch.no_grad():
        next(avatar.field.parameters()).view(-1)[0] = value
    save_avatar(avatar, path)
    with pytest.raises(LiveHandError, match=r"ada\.safetensors: the weights must be finite, got others in field\."):
        load_avatar(path)
