"""A person's skin as a path tracer needs it: what was put together, and which base color reflects as much."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.network_albedo import in_network_colours
from livehand.backend.avatars.worn_textures import BASE_COLOR, REFLECTANCE, WornTextures, worn_textures
from livehand.backend.records.errors import LiveHandError
from livehand.backend.surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.backend.surface.base_surface import whole_surface
from livehand.backend.surface.blood import place_log_albedo
from livehand.backend.surface.detail_maps import PIGMENT_COLOUR, furrow_shade
from livehand.backend.surface.detail_maps_file import ATLAS_MM, skin_detail_of

SIZE = 64


def reflected(color):
    return np.exp(np.interp(np.log(color), np.log(BASE_COLOR), np.log(REFLECTANCE)))


@pytest.fixture
def textures(light):
    """Of a person who is even, and half nail, in networks that show the known person a tenth too bright."""
    known = np.full((SIZE, SIZE, 3), (0.6, 0.35, 0.25))
    gloss = np.zeros((SIZE, SIZE, 2), np.float32)
    gloss[:, SIZE // 2 :, 1] = 1
    shown = 1.1 * reflected(known)
    empty = np.zeros((SIZE, SIZE, 3))
    none, person = np.zeros(1), light.surface.person
    detail = empty, empty[..., :2], gloss, none, none, None
    return WornTextures(light.surface, shown, shown, two_charts(), person, *detail)


def two_charts(columns=60):
    """Of a strip in two charts, whose common edge in its middle lies at both ends of the atlas."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(columns + 1.0), np.arange(2.0)))
    row = columns + 1
    corner = np.array([each for k in range(columns) for each in ([k, k + 1, k + row], [k + 1, k + row + 1, k + row])])
    middle = columns / 2
    u = np.where((x[corner].mean(1) < middle)[:, None], middle - x[corner], 3 * middle - x[corner]) / columns
    uv = torch.as_tensor(np.stack([u, y[corner]], -1), dtype=torch.float32)  # each chart is mirrored
    return AtlasTexels.of(uv, torch.as_tensor(corner), SIZE)


def test_what_networks_show_too_bright_is_blurred_over_the_skin_not_over_the_atlas(textures):
    """The middle of the strip, both ends of the atlas, is seen as one place; the atlas' middle is the strip's ends."""
    known = np.full((SIZE, SIZE, 3), (0.6, 0.35, 0.25))
    no_nail = np.zeros((SIZE, SIZE, 2), np.float32)
    shown = reflected(known) * np.where(np.arange(SIZE) < SIZE // 2, 1.2, 1.0)[:, None]
    uneven = replace(textures, network_albedo=shown, reflectance=reflected(known), gloss=no_nail)
    color = uneven.base_color(known, np.zeros((SIZE, SIZE), bool))[SIZE // 2, :, 0]
    assert color[0] == pytest.approx(color[-1], rel=2e-2)  # an edge apart
    assert color[SIZE // 2 - 1] / color[SIZE // 2] < 0.97


def test_blood_of_joints_changes_the_base_color_by_as_much_as_cycles_needs(textures):
    """What skin reflects with so much less blood, by the table, is what the changed base color reflects."""
    log_color, log_albedo = textures.joint_log_color, place_log_albedo(textures.person.melanin)
    median = np.log(np.median(textures.reflectance.reshape(-1, 3), 0))
    color = np.interp(median, np.log(REFLECTANCE), np.log(BASE_COLOR)) - 0.7 * log_color
    assert np.log(reflected(np.exp(color))) - median == pytest.approx(-0.7 * log_albedo, abs=0.02)
    assert (np.abs(log_color) < np.abs(log_albedo)).all()


@pytest.fixture(scope="module")
def light():
    return load_avatar(shipped_avatar_path("light"))


def test_skin_that_networks_show_as_the_known_person_has_that_person_s_color(textures):
    known = np.full((SIZE, SIZE, 3), (0.6, 0.35, 0.25))
    color = textures.base_color(known, np.zeros((SIZE, SIZE), bool))
    assert color[:, : SIZE // 2 - 1] == pytest.approx(known[:, : SIZE // 2 - 1], rel=2e-3)
    skin = textures.base_color(np.zeros_like(known), np.zeros((SIZE, SIZE), bool))[0, 0]
    nails = replace(textures, gloss=np.ones_like(textures.gloss)).base_color(known, np.zeros((SIZE, SIZE), bool))
    assert (nails < skin).all()  # nails reflect more of theirs
    assert color[:, -1] == pytest.approx(nails[:, -1])


def test_darker_skin_needs_a_base_color_that_reflects_so_much_less(textures):
    known = np.full((SIZE, SIZE, 3), (0.6, 0.35, 0.25))
    darker = replace(textures, reflectance=0.5 * textures.reflectance)
    color = darker.base_color(known, np.zeros((SIZE, SIZE), bool))[4, 4]
    assert reflected(color) == pytest.approx(0.5 * reflected(known[4, 4]), rel=2e-3)
    assert color[2] / known[4, 4, 2] > 0.5  # little light is scattered far in dark skin


def test_beside_the_skin_and_on_nails_nothing_is_learnt_of_networks(textures):
    known = np.full((SIZE, SIZE, 3), (0.6, 0.35, 0.25))
    none = textures.base_color(known, np.ones((SIZE, SIZE), bool))
    assert none[4, 4] == pytest.approx(textures.base_color(np.zeros_like(known), np.zeros((SIZE, SIZE), bool))[4, 4])
    assert reflected(none[4, 4]) == pytest.approx(textures.reflectance[4, 4], rel=2e-3)


@pytest.mark.slow
def test_furrows_have_the_shade_that_frames_show(light, hand):
    """A skin without relief has as much more of the colour of pigment there as detail maps take away."""
    surface = whole_surface(light.surface)
    flat = {**surface.arrays, "fine/relief": np.zeros_like(surface.arrays["fine/relief"])}
    furrowed, even = (
        worn_textures(replace(light, surface=replace(surface, arrays=arrays)), hand)
        for arrays in (surface.arrays, flat)
    )
    relief_mm = skin_detail_of(surface.arrays).fine.relief_mm
    shade = furrow_shade(relief_mm, ATLAS_MM / len(relief_mm))
    assert shade.min() < -0.2
    melanin = surface.person.melanin
    color = (1 - melanin) * np.array(PIGMENT_COLOUR[0]) + melanin * np.array(PIGMENT_COLOUR[1])
    found = np.log(furrowed.reflectance / even.reflectance)
    np.testing.assert_allclose(found, shade[..., None] * color, atol=1e-4)


@pytest.mark.slow
def test_an_avatar_s_parts_are_put_together(light, hand):
    plain_light = in_network_colours(light)
    plain = worn_textures(plain_light, hand)
    assert plain.trained_on == light.surface.person
    size = len(plain.reflectance)
    assert plain.heights.shape == (size, size, 3)
    ratio = np.full((SIZE, SIZE, 3), 20, np.int8)
    redder = replace(light.surface, arrays={**light.surface.arrays, RATIO_ARRAY: ratio}, person=light.surface.person)
    dyed = worn_textures(replace(light, surface=redder), hand)
    np.testing.assert_allclose(dyed.reflectance, plain.reflectance * np.exp(20 * RATIO_STEP), rtol=1e-4)
    assert np.array_equal(dyed.network_albedo, plain.network_albedo)


def test_an_avatar_without_a_surface_is_refused(light, hand):
    with pytest.raises(LiveHandError, match="with a surface, 'light' is not"):
        worn_textures(replace(light, surface=None), hand)
