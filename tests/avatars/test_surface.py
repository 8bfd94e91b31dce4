"""The surface of an avatar in its file, and that of files and captures of before."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars import file as avatar_module
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.captured_surface import surface_of_capture, surface_of_provenance
from livehand.backend.avatars.file import load_avatar, read_header, read_surface_of, save_avatar
from livehand.backend.avatars.library import SKINS, shipped_avatar_path
from livehand.backend.avatars.metadata import HEADER_KEY, read_metadata
from livehand.backend.avatars.tensors import PREFIX
from livehand.backend.capture.capture import Capture, SurfaceReference, load_capture, save_capture_index
from livehand.backend.capture.person import PERSONS, Person
from livehand.backend.field.field import FieldConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.albedo_ratio import RATIO_ARRAY
from livehand.backend.surface.base_surface import base_arrays, base_sha256, surface_of_person, whole_surface
from livehand.backend.surface.surface_file import surface_sha256, write_surface
from safetensors.torch import load_file, save_file

SMALL = AvatarConfig(FieldConfig(width=4, planes=((8, 2, 2),), relief=8), SuperResConfig(width=4, depth=1))


@pytest.fixture(scope="module")
def middle(hand):
    return surface_of_person(PERSONS["middle"], hand.sha256)


@pytest.fixture
def save(hand, tmp_path):
    """A function (surface) -> the file of an avatar with it."""

    def of(surface):
        made = new_avatar("ada", hand.name, hand.sha256, SMALL)
        save_avatar(replace(made, surface=surface), tmp_path / "ada.safetensors")
        return tmp_path / "ada.safetensors"

    return of


def same(ours, theirs):
    assert ours.description() == theirs.description()
    assert ours.arrays.keys() == theirs.arrays.keys()
    for name, values in theirs.arrays.items():
        assert ours.arrays[name].dtype == values.dtype
        np.testing.assert_array_equal(ours.arrays[name], values)


def test_regions_of_hair_stay_in_the_order_of_their_shares(save, middle):
    assert list(load_avatar(save(middle)).surface.hair) == ["forearm", "back", "proximal", "middle"]


def test_a_surface_by_reference_is_numbers_alone(save, middle):
    path = save(middle)
    same(load_avatar(path).surface, middle)
    assert not [name for name in load_file(path) if name.startswith(PREFIX)]
    assert read_header(path)["surface"]["person"]["melanin"] == PERSONS["middle"].melanin
    assert read_metadata(path).beta == PERSONS["middle"].beta


def test_arrays_of_its_own_are_deflated_and_the_same(save, middle):
    relief = np.random.default_rng(0).normal(0, 3, (64, 64)).astype(np.int8)
    own = {"fine/relief": relief, "flexion": base_arrays()["flexion"], "confidence": np.eye(64, dtype=np.uint8)}
    path = save(replace(middle, arrays=own))
    tensors = load_file(path)
    assert tensors[PREFIX + "fine/relief"].dtype == tensors[PREFIX + "confidence"].dtype == torch.uint8
    assert len(tensors[PREFIX + "fine/relief"]) < 64 * 64
    assert tensors[PREFIX + "flexion"].dtype == torch.float32
    same(load_avatar(path).surface, replace(middle, arrays=own))
    same(read_surface_of(path), replace(middle, arrays=own))


@pytest.mark.slow
def test_a_whole_surface_needs_no_base(save, middle, monkeypatch):
    whole = whole_surface(middle)
    path = save(whole)
    assert path.stat().st_size < 6e6
    monkeypatch.setattr("livehand.backend.surface.base_surface.base_sha256", lambda: "another version's")
    same(load_avatar(path).surface, whole)
    path = save(middle)
    with pytest.raises(LiveHandError, match=r"ada\.safetensors: the surface must name the base surface"):
        load_avatar(path)


def test_an_avatar_without_surface_has_none(save):
    path = save(None)
    assert load_avatar(path).surface is None
    assert "surface" not in read_header(path)


def resaved(path, change):
    """The file with header and tensors changed and signed anew."""
    header, tensors = read_header(path), load_file(path)
    change(header, tensors)
    header["checksum"] = avatar_module._checksum(header, tensors)
    save_file(tensors, path, metadata={HEADER_KEY: json.dumps(header)})
    return path


def other_hand(header, tensors):
    header["surface"] = {**header["surface"], "hand_sha256": "ab" * 32, "base": None}


def longer(header, tensors):
    header["surface"]["packed"]["fine/relief"] = [128, 64]


def huge(header, tensors):
    header["surface"]["packed"]["fine/relief"] = [1 << 20, 1 << 20]


def shorter(header, tensors):
    header["surface"]["packed"]["fine/relief"] = [32, 32]


def damaged(header, tensors):
    tensors[PREFIX + "fine/relief"][4:40] = 255


def without_tensor(header, tensors):
    del tensors[PREFIX + "fine/relief"]


def without_description(header, tensors):
    del header["surface"]


def unknown(header, tensors):
    tensors[PREFIX + "fine/glitter"] = torch.zeros(3)


def unknown_packed(header, tensors):
    tensors[PREFIX + "fine/glitter"] = torch.zeros(3, dtype=torch.uint8)
    header["surface"]["packed"]["fine/glitter"] = [3]


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (longer, r"fine/relief must be 8192 bytes for its shape \[128, 64\], got others"),
        (shorter, r"fine/relief must be 1024 bytes for its shape \[32, 32\], got others"),
        (huge, "fine/relief must be deflated bytes of a shape"),
        (damaged, "fine/relief must be deflated, got damaged bytes"),
        (without_tensor, "must have the surface's arrays fine/relief"),
        (without_description, "a surface must have a description"),
        (unknown, "does not know: fine/glitter; update it"),
        (unknown_packed, "does not know: fine/glitter; update it"),
    ],
)
def test_broken_surfaces_are_refused(save, middle, break_it, message):
    relief = np.random.default_rng(0).normal(0, 3, (64, 64)).astype(np.int8)
    path = save(replace(middle, arrays={"fine/relief": relief}))
    assert load_avatar(path).surface is not None
    with pytest.raises(LiveHandError, match=message):
        load_avatar(resaved(path, break_it))


@pytest.mark.slow
def test_a_surface_of_another_hand_is_refused(save, middle):
    path = save(whole_surface(middle))
    with pytest.raises(LiveHandError, match=r"the surface must lie on the avatar's hand .* got one of hand abab"):
        load_avatar(resaved(path, other_hand))


@pytest.mark.parametrize("skin", SKINS)
def test_shipped_avatars_share_the_base_and_have_their_persons_numbers(skin, hand):
    surface = load_avatar(shipped_avatar_path(skin)).surface
    assert (set(surface.arrays), surface.base, surface.hand_sha256) == ({RATIO_ARRAY}, base_sha256(), hand.sha256)
    trained_on = read_header(shipped_avatar_path(skin))["provenance"]["capture"]["plan"]["person"]
    assert json.loads(json.dumps(surface.description()["person"])) == trained_on


NUMBERS = {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2}


def reported(person=NUMBERS, **others):
    return {"made_by": "livehand capture", "plan": {"person": person}, **others}


def test_provenance_of_before_tells_of_a_surface(hand):
    beta = [0.5] * 10
    surface = surface_of_provenance(reported({**NUMBERS, "blood": 1.2, "beta": beta}), hand.sha256)
    assert surface.person == Person(melanin=0.0, blood=1.2, folds=1.0, veins_mm=0.2, beta=(0.5,) * 10)
    assert surface.base == base_sha256()


@pytest.mark.parametrize(
    "capture",
    [
        None,
        [],
        {"made_by": "livehand import", "plan": {"person": NUMBERS}},
        {"made_by": "livehand capture", "plan": {"tone": "light"}},
        reported(look_sha256=None),
        reported({**NUMBERS, "melanin": "a"}),
        reported({**NUMBERS, "melanin": float("nan")}),
        reported({**NUMBERS, "folds": 7.0}),
        reported({"melanin": 0.0, "folds": 1.0}),
        reported({**NUMBERS, "nail_polish": [1, 0, 0]}),
    ],
)
def test_another_provenance_tells_of_none(hand, capture):
    assert surface_of_provenance(capture, hand.sha256) is None


def test_provenance_tells_of_none_on_another_hand():
    assert surface_of_provenance(reported(), "0" * 64) is None


def as_version_2(header, tensors):
    header.update(format_version=2, provenance={"capture": reported({**NUMBERS, "melanin": 0.7})})
    header.pop("surface", None)


def test_files_of_version_2_get_their_persons_surface(save, hand):
    path = resaved(save(None), as_version_2)
    same(load_avatar(path).surface, surface_of_person(Person(melanin=0.7, veins_mm=0.2), hand.sha256))


def test_a_file_of_this_version_is_not_asked_for_its_provenance(hand, tmp_path):
    made = replace(new_avatar("ada", hand.name, hand.sha256, SMALL), provenance={"capture": reported()})
    save_avatar(made, tmp_path / "ada.safetensors")
    assert load_avatar(tmp_path / "ada.safetensors").surface is None


@pytest.fixture
def capture_with(tmp_path, hand):
    """A function (surface, its sha256) -> a capture that has it, as read from its folder."""

    def of(surface, sha256=None, hand_sha256=hand.sha256):
        write_surface(tmp_path / "mine.npz", surface)
        reference = SurfaceReference("mine.npz", sha256 or surface_sha256(surface))
        save_capture_index(Capture(tmp_path, hand_sha256, reported(), (HandPose.rest(),), (), surface=reference))
        return load_capture(tmp_path)

    return of


def test_a_capture_has_the_surface_of_its_file_and_not_of_its_provenance(capture_with, middle):
    same(surface_of_capture(capture_with(middle)), middle)


def test_a_captures_surface_is_that_which_it_names(capture_with, middle):
    with pytest.raises(LiveHandError, match="must hold the surface with the sha256 abab"):
        surface_of_capture(capture_with(middle, sha256="ab" * 32))


def test_a_captures_surface_lies_on_its_hand(capture_with, middle):
    with pytest.raises(LiveHandError, match="must lie on the capture's hand abab"):
        surface_of_capture(capture_with(middle, hand_sha256="ab" * 32))


@pytest.mark.parametrize("surface", ["mine.npz", {"file": "mine.npz"}, {"file": 3, "sha256": "ab"}])
def test_a_captures_index_names_file_and_sha256(tmp_path, surface):
    save_capture_index(Capture(tmp_path, "ab" * 32, {}, (HandPose.rest(),), ()))
    index = tmp_path / "transforms.json"
    index.write_text(json.dumps({**json.loads(index.read_text()), "surface": surface}))
    with pytest.raises(LiveHandError, match="surface must have a file and its sha256"):
        load_capture(tmp_path)
