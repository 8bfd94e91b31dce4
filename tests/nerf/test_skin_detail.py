"""Bump mapping at full size: slopes of known heights on a flat patch, folds that follow the pose, both backends."""

from math import exp, pi

import numpy as np
import pytest
import torch
from livehand.backend.fast.backend import NumbaBackend
from livehand.backend.geometry.mesh import Topology, posed_mesh
from livehand.backend.hand.skin_detail import ATLAS_MM, COARSEST_MM, SkinBend, SkinDetail, SkinMaps
from livehand.backend.nerf.lighting import COEFFICIENTS, DIFFUSE, GLOSS, SCATTERED
from livehand.backend.nerf.rays import HandInView, camera_tensors, ray_directions
from livehand.backend.nerf.reference import ReferenceBackend
from livehand.backend.nerf.relighting import LitImage
from livehand.backend.nerf.skin_detail import (
    BUMP,
    COARSE_TINT,
    DORSAL_MM,
    FOLD_LOG_ALBEDO,
    FOLDS,
    PALMAR_MM,
    RESOLVED_PX,
    TINT,
    DetailMaps,
    PixelDetail,
    SkinLook,
    face_gradients,
    seen_skin,
    with_detail,
)
from livehand.backend.records.camera import Camera
from torch.nn.functional import normalize

N, SIDE_M, SIZE = 64, 0.27, (24, 20)
TEXEL_MM = ATLAS_MM / N
ZERO = np.zeros((N, N), np.float32)
FLAT = {"relief_mm": ZERO, "dorsal": ZERO, "palmar": ZERO, "veins": ZERO, "pigment_light": ZERO, "pigment_deep": ZERO}
BEND = SkinBend(np.zeros(4, int), np.zeros((16, 3)))
ALONG_U = np.tile((np.arange(N) + 0.5) * TEXEL_MM, (N, 1)).astype(np.float32)  # mm


NO_NAIL = ZERO[::4, ::4]
IN_PLACE = np.zeros((2, 2, 3), np.float32)


def skin(nail=NO_NAIL, offset_mm=IN_PLACE, **maps):
    return SkinDetail(SkinMaps(**{**FLAT, **maps}), coarse_maps(), nail, offset_mm, BEND)


def coarse_maps(**maps):
    """A quarter as wide."""
    return SkinMaps(**{**{name: ZERO[::4, ::4] for name in FLAT}, **maps})


def patch(depth_m=0.5, focal_px=400.0, left_m=0.0):
    """A square as large as its atlas, u to the right and v up, seen from the front or from the left."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * SIDE_M - [SIDE_M / 2, SIDE_M / 2, 0]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    topology = Topology.of(vertices, faces, uv[faces])
    cam2world = np.diag([1.0, -1, -1, 1])
    cam2world[0, 3], cam2world[2, 3] = -left_m, depth_m
    K = np.array([[focal_px, 0, SIZE[0] / 2 - focal_px * left_m / depth_m], [0, focal_px, SIZE[1] / 2], [0, 0, 1]])
    mesh = posed_mesh(topology, torch.as_tensor(vertices, dtype=torch.float32))
    return HandInView(mesh, topology, camera_tensors(Camera(K, cam2world, SIZE), "cpu"))


def image_of(hand):
    pixel = torch.arange(SIZE[0] * SIZE[1])
    view = normalize(ray_directions(hand.camera, pixel), dim=-1)
    normal = torch.tensor([0.0, 0, 1]).expand(len(pixel), 3)
    ones = torch.ones(len(pixel), COEFFICIENTS)
    alpha = torch.ones(SIZE[1], SIZE[0])
    share, skin = torch.full((len(pixel), 4), 0.25), torch.zeros(len(pixel))
    return LitImage(pixel, ones, normal, view, share, alpha, alpha, skin)


def detailed(backend, detail, flex=0.0, melanin=0.0, folds=1.0, veins_mm=0.25, hand=None):
    hand, look = hand or patch(), SkinLook(melanin, folds, veins_mm)
    return backend.detailed_image(image_of(hand), hand, DetailMaps.of(detail, look), torch.full((4,), flex))


def tilt(slope):
    return normalize(torch.tensor([-BUMP * slope, 0.0, 1.0]), dim=0)


def test_a_ramp_tilts_the_normal_by_a_share_of_its_slope(backend):
    found = detailed(backend, skin(relief_mm=0.02 * ALONG_U))
    torch.testing.assert_close(found.normal, tilt(0.02).expand_as(found.normal), atol=2e-4, rtol=0)
    torch.testing.assert_close(found.coefficients, torch.ones_like(found.coefficients))


def test_a_larger_hand_has_larger_relief_and_the_same_slopes(backend):
    hand = patch()
    large = posed_mesh(hand.topology, 1.5 * hand.mesh.vertices)
    found = detailed(backend, skin(relief_mm=0.02 * ALONG_U), hand=hand._replace(mesh=large))
    torch.testing.assert_close(found.normal, tilt(0.02).expand_as(found.normal), atol=2e-4, rtol=0)


@pytest.mark.parametrize(("flex", "factor"), [(0.0, 1.0), (0.5, 0.525), (1.2, 0.0)])
def test_folds_on_the_back_flatten_as_the_joint_bends(backend, flex, factor):
    found = detailed(backend, skin(dorsal=0.05 * ALONG_U), flex)
    torch.testing.assert_close(found.normal[0], tilt(-0.05 * FOLDS * DORSAL_MM * factor), atol=4e-4, rtol=0)


@pytest.mark.parametrize(("flex", "factor"), [(0.0, 0.75), (0.5, 1.0)])
def test_creases_deepen_as_the_joint_bends_and_with_age(backend, flex, factor):
    found = detailed(backend, skin(palmar=0.03 * ALONG_U), flex, folds=1.4)
    torch.testing.assert_close(found.normal[0], tilt(-0.03 * 1.4 * FOLDS * PALMAR_MM * factor), atol=4e-4, rtol=0)


def test_veins_are_as_high_as_the_person_s(backend):
    found = detailed(backend, skin(veins=0.05 * ALONG_U), veins_mm=0.4)
    torch.testing.assert_close(found.normal[0], tilt(0.05 * 0.4), atol=4e-4, rtol=0)


def test_pigment_is_mixed_by_melanin_and_darkens_colours_but_not_gloss(backend):
    light, deep = np.full((N, N), -0.2, np.float32), np.full((N, N), -0.6, np.float32)
    found = detailed(backend, skin(pigment_light=light, pigment_deep=deep), melanin=0.5).coefficients
    for coloured in (SCATTERED, DIFFUSE):
        torch.testing.assert_close(found[:, coloured], torch.full_like(found[:, coloured], exp(-0.4 * TINT)))
    torch.testing.assert_close(found[:, GLOSS], torch.ones_like(found[:, GLOSS]))


def test_folds_have_their_colour(backend):
    found = detailed(backend, skin(palmar=np.full((N, N), 0.5, np.float32)), flex=0.5).coefficients
    expected = torch.exp(FOLDS * TINT * 0.45 * 0.5 * torch.tensor(FOLD_LOG_ALBEDO))
    torch.testing.assert_close(found[0, DIFFUSE], expected, atol=2e-2, rtol=0)


def test_nails_are_where_the_map_has_them(backend):
    """The right half of the atlas, which is as large as the picture."""
    half = np.tile((np.arange(N // 4) >= N // 8).astype(np.float32), (N // 4, 1))
    found = detailed(backend, skin(half), hand=patch(focal_px=SIZE[0] * 0.5 / SIDE_M))
    nail = found.nail.reshape(SIZE[1], SIZE[0])
    assert (nail[:, : SIZE[0] // 2 - 4] == 0).all()
    torch.testing.assert_close(nail[:, SIZE[0] // 2 + 4 :], torch.ones(SIZE[1], SIZE[0] // 2 - 4))
    # Of gloss 1 in each lobe, all is in the first on nails.
    torch.testing.assert_close(found.coefficients[:, GLOSS], torch.stack([1 + found.nail, 1 - found.nail], 1))


@pytest.mark.parametrize("offset_mm", [(20, 0, 0), (0, 0, 15), (10, 0, 15)])
def test_the_skin_that_is_seen_lies_beside_and_above_the_face(backend, offset_mm):
    """Pigment that grows along u tells where in the atlas pixels look; the view is from the left."""
    slope = -0.008  # of its logarithm, per mm
    ramp = {"pigment_light": slope * (ALONG_U - ATLAS_MM / 2)}
    offsets = np.full((8, 8, 3), offset_mm, np.float32)
    hand = patch(left_m=0.3)
    here, there = (detailed(backend, skin(offset_mm=each, **ramp), hand=hand) for each in (IN_PLACE, offsets))
    change = (there.coefficients / here.coefficients)[:, DIFFUSE][:, 0].log() / (TINT * slope)
    view = here.view
    expected_mm = -offset_mm[0] - offset_mm[2] * view[:, 0] / view[:, 2].abs()
    assert (expected_mm.abs() > 1).all()
    torch.testing.assert_close(change, expected_mm, atol=1.3, rtol=0)  # of stored steps


def test_gradients_pass_to_colours_gloss_and_normals():
    image = image_of(patch())
    coefficients, normal = image.coefficients.clone().requires_grad_(), image.normal.clone().requires_grad_()
    detail = PixelDetail(
        row=torch.tensor([3, 7]),
        slope=torch.tensor([[0.0, 0, 0], [1, 0, 0]]),
        albedo=torch.tensor([[0.5, 0.6, 0.7]]).expand(2, 3),
        nail=torch.tensor([1.0, 0.25]),
    )
    found = with_detail(image._replace(coefficients=coefficients, normal=normal), detail)
    (found.coefficients[:, DIFFUSE].sum() + (found.coefficients[:, GLOSS] * torch.tensor([2.0, 5])).sum()).backward()
    torch.testing.assert_close(coefficients.grad[7, DIFFUSE], torch.tensor([0.5, 0.6, 0.7]))
    torch.testing.assert_close(coefficients.grad[8, DIFFUSE], torch.ones(3))
    torch.testing.assert_close(coefficients.grad[7, GLOSS], torch.tensor([2.0, 0.25 * 2 + 0.75 * 5]))
    torch.testing.assert_close(coefficients.grad[3, GLOSS], torch.tensor([2.0, 2]))
    found.normal[7, 0].backward()
    assert normal.grad[7].isfinite().all()
    assert normal.grad[7, 0] > 0


def test_what_is_finer_than_a_pixel_is_gone_from_afar(backend):
    """Waves of four texels: seen at a texel a pixel, and averaged away at 16."""
    waves = skin(relief_mm=np.tile(0.1 * np.sin(pi / 2 * np.arange(N)), (N, 1)).astype(np.float32))
    near, far = (detailed(backend, waves, hand=patch(focal_px=0.5 / (k * TEXEL_MM / 1000))) for k in (1, 16))
    assert near.normal[:, 0].abs().max() > 0.01
    assert far.normal[:, 0].abs().max() < 1e-3


def seen_tint(texels_a_pixel, wave_texels):
    """What is seen of waves of coarse pigment, as a share of them."""
    wave = 0.3 * np.sin(2 * pi * (np.arange(16) + 0.5) / wave_texels)
    coarse = coarse_maps(pigment_light=np.tile(wave, (16, 1)).astype(np.float32))
    maps = DetailMaps.of(SkinDetail(SkinMaps(**FLAT), coarse, NO_NAIL, IN_PLACE, BEND), SkinLook(0.0, 1.0, 0.0))
    at_texels = torch.stack([(torch.arange(16) + 0.5) / 16, torch.full((16,), 0.5)], -1)
    seen = TINT * maps.sample(at_texels, torch.full((16,), float(np.log2(texels_a_pixel))))[:, 6].numpy()
    inner = slice(4, 12)  # nothing is known beyond the borders
    return (seen[inner] * wave[inner]).sum() / (wave[inner] ** 2).sum()


def test_rays_pass_over_what_is_coarse_from_afar_only():
    assert RESOLVED_PX * TEXEL_MM > COARSEST_MM  # even the finest of these maps is coarser than the planes
    assert seen_tint(1, 4) == seen_tint(2, 4) == 0.0  # pixels finer than the coarse maps
    passed_over = COARSE_TINT * (1 - np.exp(-0.5 * (2 * pi / 4 * RESOLVED_PX) ** 2))
    assert seen_tint(4, 4) == pytest.approx(passed_over, rel=0.1)
    assert 0 < seen_tint(4, 16) < 0.5 * passed_over


def test_the_image_before_is_unchanged_and_pixels_beside_the_mesh_stay(backend):
    hand = patch(focal_px=40.0)  # the patch covers 21.6 px
    before = image_of(hand)
    maps = DetailMaps.of(skin(relief_mm=0.1 * ALONG_U), SkinLook(0.0, 1.0, 0.0))
    after = backend.detailed_image(before, hand, maps, torch.zeros(4))
    beside = torch.ones(len(before.pixel), dtype=torch.bool)
    beside[seen_skin(hand, before.pixel).row] = False
    assert 0 < beside.sum() < len(beside)
    assert torch.equal(after.normal[beside], before.normal[beside])
    assert (after.normal[~beside] != before.normal[~beside]).any(1).all()
    assert torch.equal(before.normal[:, 2], torch.ones(len(beside)))


def test_gradients_of_the_atlas_are_those_of_the_plane():
    hand = patch()
    expected = torch.tensor([[1 / SIDE_M, 0, 0], [0, 1 / SIDE_M, 0]])
    torch.testing.assert_close(face_gradients(hand.mesh, hand.topology), expected.expand(2, 2, 3))


@pytest.mark.parametrize("side", ["right", "left"])
def test_both_backends_agree_on_a_posed_hand(posed, seen_from, side):
    found = posed("fist", side)
    view = seen_from(found.mesh, (0.2, -1, 0.4), size_px=(120, 110))
    hand_in_view = HandInView(found.mesh, found.topology, view)
    generator = np.random.default_rng(3)
    fine, coarse = (
        SkinMaps(**{name: generator.normal(0, 0.05, (size, size)).astype(np.float32) for name in FLAT})
        for size in (N, N // 4)
    )
    offset_mm = generator.normal(0, 0.5, (N // 4, N // 4, 3)).astype(np.float32)
    both = SkinDetail(fine, coarse, generator.random((N // 4, N // 4), np.float32), offset_mm, BEND)
    pixel = torch.arange(hand_in_view.camera.size_px[0] * hand_in_view.camera.size_px[1])
    view = normalize(ray_directions(hand_in_view.camera, pixel), dim=-1)
    skin_alone = torch.zeros(len(pixel))
    image = LitImage(pixel, torch.ones(len(pixel), COEFFICIENTS), -view, view, *[torch.zeros(1, 4)] * 3, skin_alone)
    flex = torch.rand(len(hand_in_view.mesh.vertices), generator=torch.Generator().manual_seed(0))
    of_person = DetailMaps.of(both, SkinLook(0.3, 1.2, 0.4))
    ours, theirs = (
        b.detailed_image(image, hand_in_view, of_person, flex) for b in (NumbaBackend(), ReferenceBackend())
    )
    assert (theirs.normal != image.normal).any(1).sum() > 100
    same = ((ours.normal - theirs.normal).abs().amax(1) < 1e-3).float().mean()
    assert same > 0.999  # a pixel on an edge may see the face beside it
    close = ((ours.coefficients - theirs.coefficients).abs().amax(1) < 1e-3).float().mean()
    assert close > 0.999
    assert ((ours.nail - theirs.nail).abs() < 0.02).float().mean() > 0.999
    assert theirs.nail.max() > 0.5
