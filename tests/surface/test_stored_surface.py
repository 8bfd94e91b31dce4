"""Surfaces as files hold them: what is checked, what the shared base gives, and the file beside a capture."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.person import PERSONS, Person
from livehand.backend.records.errors import LiveHandError
from livehand.backend.surface.base_surface import (
    base_arrays,
    base_sha256,
    on_base,
    surface_of_person,
    whole_surface,
)
from livehand.backend.surface.hair_growth import REGIONS
from livehand.backend.surface.stored_surface import ARRAYS, check_arrays, stored_surface
from livehand.backend.surface.surface_file import read_surface, surface_sha256, write_surface


@pytest.fixture(scope="module")
def base():
    return base_arrays()


@pytest.fixture(scope="module")
def middle(hand):
    return surface_of_person(PERSONS["middle"], hand.sha256)


def test_the_base_is_whole_and_lies_on_its_hand(base, hand):
    check_arrays(base, "base", len(REGIONS))
    assert len(base["bend/joint"]) == len(hand.v_template)
    assert base.keys() == {name for name, spec in ARRAYS.items() if not spec.is_optional}


def test_people_share_the_base_and_have_numbers_of_their_own(middle, hand, hand_without_arm):
    assert dict(middle.arrays) == {}
    assert (middle.base, middle.hand_sha256, middle.person) == (base_sha256(), hand.sha256, PERSONS["middle"])
    assert surface_of_person(PERSONS["middle"], hand_without_arm.sha256) is None
    assert surface_of_person(Person(nail_polish=(1.0, 0.0, 0.0)), hand.sha256) is None


def test_an_array_of_its_own_replaces_that_of_the_base(middle, base):
    relief = np.roll(base["fine/relief"], 5, 0)
    whole = whole_surface(replace(middle, arrays={"fine/relief": relief}))
    assert whole.base is None
    np.testing.assert_array_equal(whole.arrays["fine/relief"], relief)
    np.testing.assert_array_equal(whole.arrays["fine/dorsal"], base["fine/dorsal"])
    back = on_base(whole)
    assert (set(back.arrays), back.base) == ({"fine/relief"}, base_sha256())
    assert on_base(whole_surface(middle)) == middle


def changed(name, change):
    return lambda arrays: {**arrays, name: change(arrays[name])}


def put(name, index, value):
    def change(values):
        values = values.copy()
        values[index] = value
        return values

    return changed(name, change)


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda a: {k: v for k, v in a.items() if k != "nail"}, "must have the arrays nail, got none"),
        (lambda a: {**a, "fine/glitter": a["nail"]}, "does not know: fine/glitter; update it"),
        (changed("vein", lambda v: v.astype(np.int16)), r"vein must be int8 \[N\], got int16"),
        (changed("fine/relief", lambda v: v[:-1]), r"fine/relief must be int8 \[R, R\], R = 2047, got \[2047, 2048\]"),
        (changed("vein", lambda v: v[:-1]), r"vein must be int8 \[N\], N = 30674, got \[30673\]"),
        (changed("bend/joint", lambda v: v[:-1]), "twice subdivided from a closed mesh, with N = 30658, got N = 30674"),
        (changed("hair/share", lambda v: v[:-1]), "with M = 61344, got M = 61343"),
        (put("bend/joint", 7, 16), r"bend/joint must be within \[0, 15\], got 0 to 16"),
        (put("form/joint", 0, -1), r"form/joint must be within \[0, 15\], got -1"),
        (put("flexion", (1, 1), np.nan), "flexion must be finite"),
        (put("hair/share", (0, 0), 1.5), r"hair/share must be within \[0, 1\], got 0 to 1.5"),
        (put("form/range_deg", 3, 20.0), "form/range_deg must be from one angle to another"),
        (put("nail", (0, 0), 101), r"nail must be within \[0, 100\]"),
    ],
)
def test_broken_arrays_are_refused(base, break_it, message):
    with pytest.raises(LiveHandError, match=f"^mine.*{message}"):
        check_arrays(break_it(base), "mine", len(REGIONS))


@pytest.mark.parametrize(("resolution", "is_right"), [(64, True), (96, False), (16384, False), (1024, True)])
def test_fine_maps_are_a_pyramids_base(resolution, is_right):
    arrays = {f"fine/{name}": np.zeros((resolution, resolution), np.int8) for name in ("relief", "dorsal")}
    if is_right:
        check_arrays(arrays, "mine", len(REGIONS), is_whole=False)
    else:
        with pytest.raises(LiveHandError, match="a multiple of 64 and at most 8192 texels wide"):
            check_arrays(arrays, "mine", len(REGIONS), is_whole=False)


def test_coarse_maps_are_a_level_of_the_pyramid():
    arrays = {"fine/relief": np.zeros((128, 128), np.int8), "nail": np.zeros((48, 48), np.int8)}
    with pytest.raises(LiveHandError, match="coarse maps must be 128 texels wide, halved 0 to 5 times, got 48"):
        check_arrays(arrays, "mine", len(REGIONS), is_whole=False)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("person"), "its description must have base, hair, hand_sha256, person"),
        (lambda d: d["person"].update(melanin=3.0), "melanin must be a number between 0.0 and 1.2, got 3.0"),
        (lambda d: d["person"].update(sweat=0.5), "must be a JSON object with keys of melanin"),
        (lambda d: d["hair"][1].update(per_m2=float("nan")), "per_m2 of the hair's region 'back' must be from 0"),
        (lambda d: d["hair"][1].update(rise=0.9), "rise of the hair's region 'back' must be from 0 to 0.7"),
        (lambda d: d["hair"][1].pop("rise"), "hair must be a list of regions, each with a name of its own and per_m2"),
        (lambda d: d["hair"][1].update(name="middle"), "hair must be a list of regions, each with a name of its own"),
        (lambda d: d.update(hair=d["hair"][0]), "hair must be a list of regions"),
        (lambda d: d.update(base=3), "base text or null"),
    ],
)
def test_broken_descriptions_are_refused(middle, change, message):
    description = json.loads(json.dumps(middle.description()))
    change(description)
    with pytest.raises(LiveHandError, match=f"^mine.*{message}"):
        stored_surface(description, {}, "mine")


def test_regions_are_the_columns_of_the_shares(middle):
    description = {**middle.description(), "hair": [{"name": "back", **REGIONS["back"]._asdict()}]}
    with pytest.raises(LiveHandError, match="hair/share must have a column for each of 1 regions, got 4"):
        whole_surface(stored_surface(description, {}, "mine"))


def test_regions_stay_in_the_order_of_their_columns(middle):
    description = json.loads(json.dumps(middle.description(), sort_keys=True))
    assert list(stored_surface(description, {}, "mine").hair) == list(REGIONS)


def test_another_versions_base_is_refused(middle, tmp_path):
    path = tmp_path / "surface.npz"
    write_surface(path, replace(middle, base="0" * 64))
    with pytest.raises(LiveHandError, match=r"must name the base surface that this version has .* got 0{12}"):
        read_surface(path)
    with pytest.raises(LiveHandError, match="must name the base surface"):
        whole_surface(replace(middle, base="0" * 64))
    write_surface(path, replace(middle, hand_sha256="ab" * 32))
    with pytest.raises(LiveHandError, match="must lie on the hand of its base surface, hand_with_arm, got hand abab"):
        read_surface(path)


def test_a_file_is_read_as_written(middle, base, tmp_path):
    path = tmp_path / "surface.npz"
    own = {"form/range_deg": base["form/range_deg"], "confidence": np.eye(8, dtype=np.uint8)}
    surface = replace(middle, arrays=own)
    write_surface(path, surface)
    back = read_surface(path, surface_sha256(surface))
    assert back.description() == surface.description()
    assert back.arrays.keys() == own.keys()
    for name, values in own.items():
        np.testing.assert_array_equal(back.arrays[name], values)
        assert back.arrays[name].dtype == values.dtype


def test_another_surface_in_its_place_is_refused(middle, hand, tmp_path):
    write_surface(tmp_path / "surface.npz", surface_of_person(PERSONS["deep"], hand.sha256))
    with pytest.raises(LiveHandError, match="must hold the surface with the sha256"):
        read_surface(tmp_path / "surface.npz", surface_sha256(middle))


def test_a_file_of_something_else_is_refused(tmp_path):
    np.savez(tmp_path / "surface.npz", theta=np.zeros(3))
    with pytest.raises(LiveHandError, match="must hold a description in JSON, got none"):
        read_surface(tmp_path / "surface.npz")
