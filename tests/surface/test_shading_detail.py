"""A known skin at full size: slopes of known heights on a flat patch, folds that follow the pose, both backends."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import camera_tensors, ray_origin, view_directions
from livehand.backend.image.shading import ShadingInputs
from livehand.backend.light.brdf import ROUGHNESS
from livehand.backend.light.lighting import COEFFICIENTS, DIFFUSE, GLOSS, SCATTERED
from livehand.backend.records.camera import Camera
from livehand.backend.surface.albedo_ratio import AlbedoRatio
from livehand.backend.surface.detail_maps import BUMP, DORSAL_MM, PALMAR_MM, PIGMENT_COLOUR, DetailMaps, SkinLook
from livehand.backend.surface.detail_maps_file import ATLAS_MM, SkinFlexion, SkinMaps, SurfaceDetail
from livehand.backend.surface.detail_mesh import DetailMesh, visible_surface
from livehand.backend.surface.edge_antialiasing import SurfaceBones
from livehand.backend.surface.shading_detail import FOLD_LOG_ALBEDO, SHARPER, DetailPixels, detail_pixels, with_detail
from torch.nn.functional import normalize

pytestmark = pytest.mark.slow

N, SIDE_M, SIZE = 64, 0.27, (24, 20)
TEXEL_MM = ATLAS_MM / N
ZERO = np.zeros((N, N), np.float32)
FLAT = {"relief_mm": ZERO, "dorsal": ZERO, "palmar": ZERO, "pigment_light": ZERO, "pigment_deep": ZERO}
BEND = SkinFlexion(np.zeros(4, int), np.zeros((16, 3)))
ALONG_U = np.tile((np.arange(N) + 0.5) * TEXEL_MM, (N, 1)).astype(np.float32)  # mm


NO_NAIL = ZERO[::4, ::4]
ROUGH, RESOLVED = np.full_like(NO_NAIL, 0.5), np.zeros((2, N // 4, N // 4), np.float32)


def skin(nail=NO_NAIL, **maps):
    return SurfaceDetail(SkinMaps(**{**FLAT, **maps}), coarse_maps(), nail, ROUGH, RESOLVED, BEND)


def coarse_maps(**maps):
    """A quarter as wide."""
    return SkinMaps(**{**{name: ZERO[::4, ::4] for name in FLAT}, **maps})


def patch(depth_m=0.5, focal_px=400.0, scale=1.0, flex=0.0):
    """A square as large as its atlas, u to the right and v up, seen from the front; and its camera."""
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    vertices = scale * SIDE_M * (corners - torch.tensor([0.5, 0.5, 0]))
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    normals = torch.tensor([0.0, 0, 1]).expand(4, 3)
    bones = SurfaceBones(torch.zeros(len(faces), dtype=torch.int8), torch.tensor([[False]]))
    mesh = DetailMesh(
        vertices, normals, faces, corners[faces][..., :2], torch.full((4,), flex), torch.tensor(scale), bones, faces
    )
    cam2world = np.diag([1.0, -1, -1, 1])
    cam2world[2, 3] = depth_m
    K = np.array([[focal_px, 0, SIZE[0] / 2], [0, focal_px, SIZE[1] / 2], [0, 0, 1]])
    return mesh, camera_tensors(Camera(K, cam2world, SIZE), "cpu")


def image_of(camera):
    pixel = torch.arange(camera.size_px[0] * camera.size_px[1])
    normal, view = torch.tensor([0.0, 0, 1]).expand(len(pixel), 3), view_directions(camera, pixel)
    ones, alpha = torch.ones(len(pixel), COEFFICIENTS), torch.ones(camera.size_px[1], camera.size_px[0])
    share = torch.full((len(pixel), 4), 0.25)
    return ShadingInputs(pixel, ones, normal, view, share, alpha, alpha)


def detailed(backend, detail, flex=0.0, melanin=0.0, folds=1.0, of=None):
    mesh, camera = of or patch(flex=flex)
    maps, seen = DetailMaps.of(detail, SkinLook(melanin, folds, 0.25)), backend.visible_surface(mesh, camera)
    return backend.detailed_image(image_of(camera), seen, mesh, camera, maps)


def of_skin(coefficients):
    """The coefficients with the gloss of skin; they are premultiplied by the first."""
    gloss = torch.tensor([0.0, 1]) * coefficients[:, :1]
    return torch.cat([coefficients[:, : GLOSS.start], gloss], 1)


def tilt(slope):
    return normalize(torch.tensor([-BUMP * slope, 0.0, 1.0]), dim=0)


def test_a_ramp_tilts_the_normal_by_a_share_of_its_slope(backend):
    found = detailed(backend, skin(relief_mm=0.02 * ALONG_U))
    torch.testing.assert_close(found.normal, tilt(0.02).expand_as(found.normal), atol=2e-4, rtol=0)
    torch.testing.assert_close(found.coefficients, of_skin(torch.ones_like(found.coefficients)))


def test_a_larger_hand_has_larger_relief_and_the_same_slopes(backend):
    found = detailed(backend, skin(relief_mm=0.02 * ALONG_U), of=patch(scale=1.5))
    torch.testing.assert_close(found.normal, tilt(0.02).expand_as(found.normal), atol=2e-4, rtol=0)


@pytest.mark.parametrize(("flex", "factor"), [(0.0, 1.0), (0.5, 0.64), (1.4, 0.0)])
def test_folds_on_the_back_flatten_as_the_joint_bends(backend, flex, factor):
    found = detailed(backend, skin(dorsal=0.05 * ALONG_U), flex)
    torch.testing.assert_close(found.normal[0], tilt(-0.05 * DORSAL_MM * factor), atol=4e-4, rtol=0)


@pytest.mark.parametrize(("flex", "factor"), [(0.0, 0.75), (0.5, 1.0)])
def test_creases_deepen_as_the_joint_bends_and_with_age(backend, flex, factor):
    found = detailed(backend, skin(palmar=0.03 * ALONG_U), flex, folds=1.4)
    torch.testing.assert_close(found.normal[0], tilt(-0.03 * 1.4 * PALMAR_MM * factor), atol=4e-4, rtol=0)


@pytest.mark.parametrize("texels_a_pixel", [0.25, 1, 4])
def test_coarse_relief_shows_from_near_and_from_afar(backend, texels_a_pixel):
    """A ramp of the coarse maps, a quarter as wide: the mesh knows nothing of it, however near."""
    coarse = coarse_maps(relief_mm=0.02 * ALONG_U[::4, ::4])
    of = patch(focal_px=0.5 / (texels_a_pixel * TEXEL_MM / 1000))
    found = detailed(backend, SurfaceDetail(SkinMaps(**FLAT), coarse, NO_NAIL, ROUGH, RESOLVED, BEND), of=of)
    middle = len(found.normal) // 2 + SIZE[0] // 2
    torch.testing.assert_close(found.normal[middle], tilt(0.02), atol=4e-4, rtol=0)


def test_pigment_is_mixed_by_melanin_and_darkens_colours_but_not_gloss(backend):
    light, deep = np.full((N, N), -0.2, np.float32), np.full((N, N), -0.6, np.float32)
    found = detailed(backend, skin(pigment_light=light, pigment_deep=deep), melanin=0.5).coefficients
    expected = torch.exp(-0.4 * torch.tensor(PIGMENT_COLOUR).mean(0))
    for coloured in (SCATTERED, DIFFUSE):
        colours = found[:, coloured].reshape(len(found), -1, 3)
        torch.testing.assert_close(colours, expected.expand_as(colours))
    torch.testing.assert_close(found[:, GLOSS], torch.tensor([0.0, 1]).expand(len(found), 2))


def test_folds_have_their_colour(backend):
    found = detailed(backend, skin(palmar=np.full((N, N), 0.5, np.float32)), flex=0.5).coefficients
    expected = torch.exp(0.45 * 0.5 * torch.tensor(FOLD_LOG_ALBEDO))
    torch.testing.assert_close(found[0, DIFFUSE], expected, atol=2e-2, rtol=0)


def test_nails_are_where_the_map_has_them(backend):
    """The right half of the atlas, which is as large as the picture."""
    half = np.tile((np.arange(N // 4) >= N // 8).astype(np.float32), (N // 4, 1))
    found = detailed(backend, skin(half), of=patch(focal_px=SIZE[0] * 0.5 / SIDE_M))
    nail = found.skin.nail.reshape(SIZE[1], SIZE[0])
    assert (nail[:, : SIZE[0] // 2 - 4] == 0).all()
    torch.testing.assert_close(nail[:, SIZE[0] // 2 + 4 :], torch.ones(SIZE[1], SIZE[0] // 2 - 4))
    torch.testing.assert_close(found.coefficients[:, GLOSS], torch.stack([found.skin.nail, 1 - found.skin.nail], 1))


def test_gradients_pass_to_colours_and_gloss_is_known():
    _, camera = patch()
    image = image_of(camera)
    coefficients = image.coefficients.clone().requires_grad_()
    known = DetailPixels(
        coverage=torch.ones(len(image.pixel)),
        depth=torch.ones(len(image.pixel)),
        row=torch.tensor([3, 7]),
        normal=torch.tensor([[0.0, 0, 1], [1, 0, 0]]),
        surface_normal=torch.tensor([[0.0, 0, 1], [0, 1, 0]]),
        albedo=torch.tensor([[0.5, 0.6, 0.7]]).expand(2, 3),
        nail=torch.tensor([1.0, 0.25]),
        blurred_normal=torch.tensor([[0.0, 0, 1], [0, 0.6, 0.8]]),
        alpha_squared=torch.tensor([0.05, 0.07]),
        sharpness=torch.tensor([0.0, 0.5, 1]),
    )
    found = with_detail(image._replace(coefficients=coefficients), known)
    (found.coefficients[:, DIFFUSE].sum() + (found.coefficients[:, GLOSS] * torch.tensor([2.0, 5])).sum()).backward()
    torch.testing.assert_close(found.coefficients[[3, 7, 8], GLOSS], torch.tensor([[1.0, 0], [0.25, 0.75], [0, 1]]))
    torch.testing.assert_close(coefficients.grad[7, DIFFUSE], torch.tensor([0.5, 0.6, 0.7]))
    torch.testing.assert_close(coefficients.grad[8, DIFFUSE], torch.ones(3))
    assert coefficients.grad[:, GLOSS].abs().max() == 0
    torch.testing.assert_close(found.normal[7], torch.tensor([1.0, 0, 0]))
    torch.testing.assert_close(found.skin.surface_normal[7], torch.tensor([0.0, 1, 0]))
    torch.testing.assert_close(found.skin.blurred_normal[7], torch.tensor([0.0, 0.6, 0.8]))
    torch.testing.assert_close(found.skin.alpha_squared[[7, 8]], torch.tensor([0.07, ROUGHNESS[1] ** 4]))


def test_what_is_finer_than_a_pixel_is_gone_from_afar(backend):
    """Waves of four texels: seen at a texel a pixel, and averaged away at 16."""
    heights = np.tile(0.1 * np.sin(pi / 2 * np.arange(N)) * np.sin(pi / N * np.arange(N)), (N, 1))
    waves = skin(relief_mm=heights.astype(np.float32))
    near, far = (detailed(backend, waves, of=patch(focal_px=0.5 / (k * TEXEL_MM / 1000))) for k in (1, 16))
    assert near.normal[:, 0].abs().max() > 0.01
    assert far.normal[:, 0].abs().max() < 1.6e-3 * BUMP


def test_far_scattered_light_shows_relief_as_a_coarser_level_does(backend):
    """Waves of eight texels: blurred from near, as sharp as the image is from afar, and sharper on deep skin."""
    waves = skin(relief_mm=np.tile(0.1 * np.sin(pi / 4 * np.arange(N)), (N, 1)).astype(np.float32))
    bends = []
    for melanin, texels_a_pixel in ((0.0, 0.5), (1.0, 0.5), (0.0, 8)):
        of = patch(focal_px=0.5 / (texels_a_pixel * TEXEL_MM / 1000))
        found = detailed(backend, waves, melanin=melanin, of=of)
        middle = slice(len(found.normal) // 4, -len(found.normal) // 4)
        bends.append([values[middle, 0].abs().max() for values in (found.normal, found.skin.blurred_normal)])
    (near, light), (_, deep), (far, far_blurred) = bends
    assert light < 0.5 * near
    assert light < 0.7 * deep < 0.7 * near
    assert far == far_blurred


def test_slopes_that_the_fine_surface_lacks_bend_its_normals(backend):
    """By all of them: they are no relief, of which a share shows."""
    detail = replace(skin(), unresolved=np.stack([np.full_like(NO_NAIL, 0.01), np.full_like(NO_NAIL, -0.02)]))
    found = detailed(backend, detail)
    expected = normalize(torch.tensor([-0.01, 0.02, 1.0]), dim=0)
    torch.testing.assert_close(found.normal, expected.expand_as(found.normal), atol=4e-4, rtol=0)


@pytest.mark.parametrize(("flex", "factor"), [(0.0, 1.0), (0.5, 0.64), (1.4, 0.0)])
def test_folds_that_a_pixel_hides_widen_its_gloss_as_far_as_they_show(backend, flex, factor):
    """Waves of four texels, gone at a level of four."""
    folds = np.tile(0.6 * np.sin(pi / 2 * np.arange(N)), (N, 1)).astype(np.float32)
    of = patch(flex=flex, focal_px=0.5 / (4 * 2**SHARPER * TEXEL_MM / 1000))
    alpha_squared = detailed(backend, skin(dorsal=folds), of=of).skin.alpha_squared.reshape(SIZE[1], SIZE[0])
    slope = 0.849 * pi / 2 * 0.6 * DORSAL_MM / TEXEL_MM * BUMP * factor
    assert float(alpha_squared[SIZE[1] // 2, SIZE[0] // 2]) == pytest.approx(0.5**4 + slope**2 / 2, abs=1.5e-3)
    assert flex > 0.5 or slope**2 / 2 > 5e-4


def test_gloss_is_as_wide_as_the_skin_is_rough(backend):
    found = detailed(backend, skin())
    torch.testing.assert_close(
        found.skin.alpha_squared, torch.full_like(found.skin.alpha_squared, 0.5**4), atol=1e-3, rtol=0
    )


def turned_patch(angle_rad):
    """The patch, a texel a pixel, turned about u; and its normal."""
    mesh, camera = patch(focal_px=0.5 / (TEXEL_MM / 1000))
    cosine, sine = float(np.cos(angle_rad)), float(np.sin(angle_rad))
    turned = torch.tensor([[1.0, 0, 0], [0, cosine, sine], [0, -sine, cosine]])
    return (mesh._replace(vertices=mesh.vertices @ turned, normals=mesh.normals @ turned), camera), turned[2]


WAVES = np.tile(0.1 * np.sin(pi / 2 * np.arange(N)), (N, 1)).astype(np.float32)


@pytest.mark.parametrize(("along", "shows"), [(0, True), (1, False)])
def test_faces_seen_from_the_side_are_filtered_in_the_direction_in_which_they_are_tilted(backend, along, shows):
    """Waves of four texels, a texel a pixel, on a face turned by 75 degrees: those across the tilt stay."""
    of, normal = turned_patch(1.3)
    found = detailed(backend, skin(relief_mm=WAVES if along == 0 else WAVES.T.copy()), of=of)
    on_it = backend.visible_surface(*of).face >= 0
    bend = (found.normal - found.skin.surface_normal)[on_it].norm(dim=1).mean()
    assert on_it.sum() > 100
    torch.testing.assert_close(found.skin.surface_normal[on_it], normal.expand(int(on_it.sum()), 3), atol=1e-5, rtol=0)
    assert (bend > 0.012) if shows else (bend < 0.004)


@pytest.mark.parametrize("cosine", [0.8, 1 / 1.5, 1 / 2.25])
def test_nothing_jumps_where_a_face_gets_another_tap(backend, cosine):
    """Lines across the tilt are as sharp before as after: else an edge would pass over skin that turns."""
    bends = []
    for angle_rad in np.arccos(cosine) + np.array([-0.02, 0.02]):
        of, _ = turned_patch(angle_rad)
        found = detailed(backend, skin(relief_mm=WAVES), of=of)
        row = SIZE[1] // 2 * SIZE[0]
        middle = slice(row + 4, row + SIZE[0] - 4)
        bends.append((found.normal - found.skin.surface_normal)[middle].norm(dim=1).mean())
    assert bends[0] > 0.01
    assert float(bends[1] / bends[0]) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("texels_a_pixel", [1.0, 2.0])
def test_a_pixel_shows_levels_a_little_finer_than_itself(backend, texels_a_pixel):
    """As levels are read straight on, between two of them."""
    waves = np.tile(0.1 * np.sin(pi / 4 * np.arange(N)), (N, 1)).astype(np.float32)
    detail = skin(relief_mm=waves)
    mesh, camera = patch(focal_px=0.5 / (texels_a_pixel * TEXEL_MM / 1000))
    found = detailed(backend, detail, of=(mesh, camera))
    maps = DetailMaps.of(detail, SkinLook(0.0, 1.0, 0.25))
    view = view_directions(camera, found.pixel)
    uv = 0.5 - 0.5 * (view / view[:, 2:])[:, :2] * torch.tensor([1.0, 1.0]) / SIDE_M
    level = torch.full((len(uv),), float(np.log2(texels_a_pixel)) - SHARPER)
    slope = maps.sample(uv, level)[:, 0] / TEXEL_MM
    torch.testing.assert_close(-found.normal[:, 0] / found.normal[:, 2], BUMP * slope, atol=2e-4, rtol=0)
    assert slope.abs().max() > 0.005


def test_nails_end_before_their_rims(backend):
    """Where the map holds less than four fifths of a nail, there is none."""
    for share, shown in ((0.75, 0.0), (0.9, 0.5), (1.0, 1.0)):
        found = detailed(backend, skin(np.full((N // 4, N // 4), share, np.float32)))
        torch.testing.assert_close(found.skin.nail, torch.full_like(found.skin.nail, shown), atol=1e-4, rtol=0)


def test_the_surface_tells_the_outline(backend):
    """Straight colours stay, whatever the field took for the outline; normals beside the surface stay, too."""
    mesh, camera = patch(focal_px=40.2)  # the patch covers 21.7 px
    before = image_of(camera)
    field = torch.linspace(0.2, 0.9, SIZE[0]).expand(SIZE[1], SIZE[0])
    before = before._replace(alpha=field, coefficients=before.coefficients * field.reshape(-1, 1))
    maps, seen = DetailMaps.of(skin(), SkinLook(0.0, 1.0, 0.0)), backend.visible_surface(mesh, camera)
    after = backend.detailed_image(before, seen, mesh, camera, maps)
    torch.testing.assert_close(after.alpha.flatten(), seen.coverage)
    torch.testing.assert_close(after.depth.flatten(), seen.depth)
    assert 0.2 < after.alpha[SIZE[1] // 2, 1] < 0.9
    torch.testing.assert_close(after.coefficients, of_skin(seen.coverage[:, None].expand_as(after.coefficients)))
    beside = seen.face < 0
    assert 0 < beside.sum() < len(beside)
    assert torch.equal(after.normal[beside], before.normal[beside])
    torch.testing.assert_close(after.normal[~beside], torch.tensor([0.0, 0, 1]).expand(int((~beside).sum()), 3))
    assert torch.equal(before.alpha, field)  # the image before is unchanged


def test_normals_are_interpolated_between_vertices(backend):
    """Those of a sphere's cap on a flat square: at every pixel along the place itself."""
    mesh, camera = patch(focal_px=40.2)
    mesh = mesh._replace(normals=normalize(mesh.vertices + torch.tensor([0.0, 0, 0.2]), dim=-1))
    maps, seen = DetailMaps.of(skin(), SkinLook(0.0, 1.0, 0.0)), backend.visible_surface(mesh, camera)
    found = backend.detailed_image(image_of(camera), seen, mesh, camera, maps)
    on_it = seen.face >= 0
    view = view_directions(camera, found.pixel)[on_it]
    place = torch.tensor([0.0, 0, 0.5]) + seen.depth[on_it, None] * view / view[:, 2:].abs()
    torch.testing.assert_close(seen.depth[on_it], torch.full_like(seen.depth[on_it], 0.5))
    expected = normalize(place + torch.tensor([0.0, 0, 0.2]), dim=-1)
    torch.testing.assert_close(found.normal[on_it], expected, atol=1e-5, rtol=0)  # corners are equally far away


def off_by_rounding(mesh, camera, face, view):
    """How far interpolated normals may be off by rounding, for pixels [P] that see these faces.

    A point on a face is found from the camera: a view of 4 roundings, and a distance to the plane, which is a quotient
    of two products of three numbers, of 12 over the cosine of view and face. Together they move the point along the
    face by at most 16 of the distance over that cosine. Both of its weights change by that over the least height of
    the triangle, and the normal by these times the largest difference of corners' normals. The last 8 are of the
    normal's own sum and length.
    """
    corners = mesh.faces[face.clamp(min=0)]
    at, normals = mesh.vertices[corners].double(), mesh.normals[corners].double()
    sides = at.roll(-1, 1) - at
    across = torch.linalg.cross(sides[:, 0], sides[:, 1])
    height_m = across.norm(dim=1) / sides.norm(dim=2).amax(1)
    cosine = (normalize(across, dim=1) * view).sum(1).abs()
    apart = (normals.roll(-1, 1) - normals).norm(dim=2).amax(1)
    distance_m = (at.mean(1) - ray_origin(camera)).norm(dim=1)
    unit = 2.0**-24
    return torch.where(face >= 0, 2 * 16 * unit * distance_m / cosine / height_m * apart + 8 * unit, 0)


def test_the_factor_on_albedo_multiplies_colours_alone(backend):
    mesh, camera = patch()
    factor = AlbedoRatio.of(np.tile(np.array([20, 0, -40], np.int8), (N, N, 1)))
    maps, seen = DetailMaps.of(skin(), SkinLook(0.0, 1.0, 0.25)), backend.visible_surface(mesh, camera)
    without, with_it = (
        backend.detailed_image(image_of(camera), seen, mesh, camera, one) for one in (maps, maps._replace(ratio=factor))
    )
    wanted = without.coefficients.clone()
    wanted[:, SCATTERED.start : DIFFUSE.stop] *= torch.exp(torch.tensor([0.3, 0, -0.6])).repeat(3)
    torch.testing.assert_close(with_it.coefficients, wanted, atol=1e-5, rtol=0)
    assert torch.equal(with_it.normal, without.normal)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
def test_both_backends_agree_on_a_posed_hand(backend_pair, fine_hand, view_from, side):
    mesh = fine_hand("fist", side)
    camera = view_from(mesh, (0.2, -1, 0.4), size_px=(120, 110))
    generator = np.random.default_rng(3)
    fine, coarse = (
        SkinMaps(**{name: generator.normal(0, 0.05, (size, size)).astype(np.float32) for name in FLAT})
        for size in (N, N // 4)
    )
    both = SurfaceDetail(fine, coarse, generator.random((N // 4, N // 4), np.float32), ROUGH, RESOLVED, BEND)
    ratio = AlbedoRatio.of(generator.integers(-60, 60, (2 * N, 2 * N, 3), np.int8))
    of_person = DetailMaps.of(both, SkinLook(0.3, 1.2, 0.4))._replace(ratio=ratio)
    image = image_of(camera)
    seen = visible_surface(mesh, camera)
    ours, theirs = (b.detailed_image(image, seen, mesh, camera, of_person) for b in backend_pair)
    assert (theirs.normal != image.normal).any(1).sum() > 1000
    torch.testing.assert_close(ours.normal, theirs.normal, atol=2e-3, rtol=0)
    off = (ours.skin.surface_normal - theirs.skin.surface_normal).abs().amax(1)
    assert (off <= off_by_rounding(mesh, camera, seen.face[image.pixel], image.view)).all()
    for name, bound in (("blurred_normal", 2e-3), ("alpha_squared", 5e-4), ("nail", 5e-3)):
        torch.testing.assert_close(getattr(ours.skin, name), getattr(theirs.skin, name), atol=bound, rtol=0)
    assert (ours.skin.surface_normal != ours.normal).any(1).sum() > 1000
    assert torch.equal(ours.skin.sharpness, theirs.skin.sharpness)
    torch.testing.assert_close(ours.coefficients, theirs.coefficients, atol=2e-3, rtol=0)
    torch.testing.assert_close(ours.alpha, theirs.alpha)
    assert theirs.skin.nail.max() > 0.5
    covered = detail_pixels(image.pixel, image.view, seen, mesh, camera, of_person).coverage
    torch.testing.assert_close(theirs.alpha.flatten(), covered)
