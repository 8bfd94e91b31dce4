"""Which skin a ray shows beside the outline of a finger: what may stand out of it, or what lies behind; its lamps."""

import numpy as np
import pytest
import torch
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.rays import HandInView, RenderedRays, camera_tensors
from livehand.backend.field.relightable import RelightableField
from livehand.backend.field.volume import Composite
from livehand.backend.geometry.mesh import PosedMesh
from livehand.backend.geometry.rasterise import NearestFronts
from livehand.backend.image.shading import SurfaceDepth
from livehand.backend.light.indirect_diffuse import MeshPoints, indirect_diffuse_on_mesh, surfel_vertices
from livehand.backend.light.lamp_samples import LampSamples
from livehand.backend.light.lighting import SurfacePoints, light_features
from livehand.backend.light.samples import FINAL, LightQuality, LightSamples
from livehand.backend.light.shadow_maps import FAR, Bounds, ShadowViews
from livehand.backend.light.sky_samples import SKY_DIRECTIONS
from livehand.backend.light.visibility import direction_frames
from livehand.backend.records.camera import Camera
from livehand.backend.records.light import Lamp, Light, Sky, sky_directions
from livehand.backend.render.light_visibility import (
    CELL_MAP_PX,
    NO_OCCLUDERS,
    features_with_nearby,
    light_shadows,
    nearby_geometry_of,
    sky_shadows,
    split_points,
    with_parts,
)
from livehand.backend.render.primary_hits import (
    HitSurface,
    SkinLayers,
    is_off_edges,
    ray_positions,
    surface_points,
)
from livehand.backend.surface.detail_mesh import DetailMesh
from livehand.backend.surface.edge_antialiasing import SurfaceBones
from livehand.backend.surface.ray_hits import RayHits

SIZE = (4, 1)
FINGER_M, PALM_M = 0.50, 0.60
EDGE = torch.tensor(0.003)
INF = torch.inf


def rays(before, pixel=(0, 1, 2, 3)):
    """Rays of two samples, at the finger and at the palm, with these shares of their opacity on the first."""
    before = torch.tensor(before)
    weights = torch.stack([before, 1 - before], 1)
    composite = Composite(torch.zeros(len(before), 1), torch.ones(len(before)), torch.ones(len(before)), weights)
    depth = torch.tensor([FINGER_M, PALM_M]).expand(len(before), 2)
    return RenderedRays(torch.tensor(pixel), composite, depth, torch.full((len(before),), 0.001))


def layers(mesh, outer):
    return SkinLayers(fronts(mesh, 0), fronts(outer, 1), EDGE)


def fronts(depth, face):
    depth = torch.as_tensor(depth)
    return NearestFronts(depth, torch.where(depth.isfinite(), face, -1))


def test_what_may_stand_out_counts_beside_the_outline_alone():
    """On the finger its mesh; beside it, before palm or background, what stands out; on the palm the palm."""
    found = layers([FINGER_M, PALM_M, INF, PALM_M], [FINGER_M - 0.0006, FINGER_M, FINGER_M, PALM_M - 0.0006]).first
    assert found.depth.tolist() == pytest.approx([FINGER_M, FINGER_M, FINGER_M, PALM_M])


def test_rays_that_pass_the_outline_show_what_lies_behind():
    both = layers([FINGER_M, PALM_M, PALM_M, INF], [FINGER_M - 0.0006, FINGER_M, FINGER_M, FINGER_M])
    found = both.visible_to(rays([0.9, 0.6, 0.4, 0.1]), SIZE)
    assert found.depth.tolist() == pytest.approx([FINGER_M, FINGER_M, PALM_M, FINGER_M])
    assert found.edge_m == EDGE


def test_an_image_shows_a_ray_s_surface_alone_where_nothing_else_is_near():
    none = float("inf")
    finger, palm = 0.500, 0.540
    depth = [[finger] * 4 + [palm] * 4 + [none] * 4] * 5
    shown = SurfaceDepth(torch.tensor(depth).flatten(), EDGE)
    rays = torch.tensor([[finger] * 6 + [palm] * 6] * 5)  # what is seen is wider than the mesh
    rays[:, 1] = 0.502
    of_row = is_off_edges(shown, rays.flatten(), torch.arange(60), (12, 5)).view(5, 12)[2]
    #        the finger       its rim | wider: the palm there | palm | its rim | far beside
    assert of_row.tolist() == [True] * 3 + [False] * 3 + [True] * 3 + [False] * 3


def test_at_full_size_the_rays_around_a_pixel_tell_by_their_shares():
    """Between a ray on the finger and one on the palm, the outline lies where their bilinear shares are equal."""
    beside = layers([[PALM_M] * 8] * 2, [[FINGER_M] * 8] * 2)
    beside = SkinLayers(*(NearestFronts(*(each.flatten() for each in layer)) for layer in beside[:2]), EDGE)
    found = beside.visible_to(rays([1.0, 1.0, 0.0, 0.0]), SIZE).depth.reshape(2, 8)
    expected = torch.tensor([FINGER_M] * 4 + [PALM_M] * 4).expand(2, 8)
    torch.testing.assert_close(found, expected)


def test_pixels_without_rays_have_no_say():
    beside = layers([PALM_M] * 16, [FINGER_M] * 16)
    found = beside.visible_to(rays([0.0], pixel=(1,)), SIZE).depth.reshape(2, 8)
    has_ray = torch.tensor([False, True, True, True, True, False, False, False])
    torch.testing.assert_close(found, torch.where(has_ray, PALM_M, FINGER_M).expand(2, 8))


@pytest.mark.slow
def test_skin_that_sheds_light_may_be_lit_by_fewer_samples_than_the_rays(backend, posed, view_from):
    """A soft lamp: both ways the probes receive nearly the same, and the rays' shadows are of all samples."""
    one = posed("fist")
    hand = HandInView(one.mesh, one.topology, view_from(one.mesh, (0.2, -1, 0.3)))
    lamps = (Lamp("point", np.ones(3), np.array([0.1, -0.25, 0.2]), radius_m=0.04),)
    bounds, position, white = Bounds.of(one.mesh), one.mesh.vertices[::7], torch.ones(3)
    fine = LightSamples.of(Light(lamps, shadow_quality="fine"), bounds)
    coarse = LampSamples.of(lamps, bounds)
    of_sky = sky_shadows(backend, hand, NO_OCCLUDERS, position)
    whole, quick, rough = (
        light_shadows(backend, hand, light, NO_OCCLUDERS, position, of_sky, white, fewer)
        for light, fewer in ((fine, None), (fine, coarse), (fine._replace(lamps=coarse), None))
    )
    assert torch.equal(quick.lamps.lit, whole.lamps.lit)
    assert torch.equal(quick.surfels.of_lamps, rough.surfels.of_lamps)
    assert 0 < (quick.surfels.of_lamps - whole.surfels.of_lamps).abs().mean() < 0.05 * whole.surfels.of_lamps.mean()


def test_of_a_sky_that_is_looked_at_along_few_directions_each_cell_has_the_nearest_ones_shadows(
    backend, posed, view_from
):
    one = posed("fist")
    hand = HandInView(one.mesh, one.topology, view_from(one.mesh, (0.2, -1, 0.3)), light_quality=LightQuality(16, 100))
    position = one.mesh.vertices[::7]
    found = sky_shadows(backend, hand, NO_OCCLUDERS, position)
    few = direction_frames(16, "cpu")[:, 2]
    nearest = (direction_frames(SKY_DIRECTIONS, "cpu")[:, 2] @ few.T).argmax(1)
    points = torch.cat([position, one.mesh.vertices[surfel_vertices(len(one.mesh.vertices), 100)]])
    views = ShadowViews.along(few, torch.full((16,), FAR))
    of_few = backend.point_shadows(one.mesh, one.topology.faces, NO_OCCLUDERS, views, points, CELL_MAP_PX)
    torch.testing.assert_close(found.lit, of_few.lit[nearest])
    torch.testing.assert_close(found.depth_in_m, of_few.depth_in_m[nearest])
    assert len(nearest.unique()) == 16
    whole = sky_shadows(backend, hand._replace(light_quality=FINAL), NO_OCCLUDERS, position)
    here, there = (split_points(shadows, len(position))[0].lit.mean(0) for shadows in (found, whole))
    assert 0 < (here - there).abs().mean() < 0.04  # of the sky, at each point


def test_few_probes_have_the_albedo_of_their_own_vertices(backend, posed, view_from):
    one = posed("fist")
    hand = HandInView(one.mesh, one.topology, view_from(one.mesh, (0.2, -1, 0.3)), light_quality=LightQuality(16, 100))
    position, light = one.mesh.vertices[:5], LightSamples.of(Light(), Bounds.of(one.mesh))
    albedo = torch.rand(len(one.mesh.vertices), 3, generator=torch.Generator().manual_seed(1))
    of_sky = sky_shadows(backend, hand, NO_OCCLUDERS, position)
    surfels = light_shadows(backend, hand, light, NO_OCCLUDERS, position, of_sky, albedo).surfels
    assert torch.equal(surfels.albedo, albedo[surfel_vertices(len(one.mesh.vertices), 100)])
    assert surfels.of_sky.shape == (SKY_DIRECTIONS, 100)


@pytest.mark.slow
def test_a_window_of_the_sky_casts_softer_shadows_in_finer_parts(backend, spheres, view_from):
    """On a ball, across the edge of a shadow, light falls in more and smaller steps; whole cells are as before."""
    mesh, topology = spheres(((0, 0, 0), 0.1), subdivisions=4)
    hand = HandInView(mesh, topology, view_from(mesh, (1, 0.2, 0.3)))
    board = torch.tensor([[[0.3, 0, -0.9], [0.3, 0, 0.9], [0.3, 9, 0]]])
    y = torch.linspace(-0.06, 0.06, 200)
    position = torch.stack([(0.01 - y**2).sqrt(), y, torch.zeros(200)], 1)
    window = Sky(np.where(sky_directions(64, 128) @ (1.0, 0, 0) > np.cos(0.35), 1.0, 0.01)[..., None].repeat(3, 2))
    of_cells, steps = sky_shadows(backend, hand, board, position), []
    for shadow_quality in ("none", "coarse", "fine"):
        sky = LightSamples.of(Light(sky=window, shadow_quality=shadow_quality), Bounds.of(mesh)).sky
        shadows = with_parts(of_cells, sky, backend, hand, board, position)
        assert torch.equal(shadows.lit[:SKY_DIRECTIONS], of_cells.lit)
        assert len(shadows.lit) == len(shadows.depth_in_m) == len(sky.towards)
        arriving = (split_points(shadows, len(position))[0].lit * sky.flux[:, :1]).sum(0) / sky.flux[:, 0].sum()
        assert arriving.max() - arriving.min() > 0.5
        steps.append(float(arriving.diff().abs().max()))
    assert steps[0] > 1.5 * steps[1] > 1.5 * 1.5 * steps[2]


@pytest.mark.slow
def test_what_stands_around_lights_skin_that_lights_skin(backend, posed, view_from):
    """Beside a lit wall: on the points as before, and by the indirect light of what the probes receive of it."""
    one = posed("fist")
    hand = HandInView(one.mesh, one.topology, view_from(one.mesh, (0.2, -1, 0.3)))
    bounds, chosen = Bounds.of(one.mesh), torch.arange(0, len(one.mesh.vertices), 7)
    centre, radius = bounds.centre.numpy(), float(bounds.radius)
    wall = centre + radius * np.array([[[1.2, -9, -9], [1.2, 9, -9], [1.2, 0, 9]]])
    light = Light((Lamp("sun", np.ones(3), rotation=np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])),), None, wall)
    light = Light(light.lamps, None, wall, np.full((1, 3), 0.8))
    samples, albedo = LightSamples.of(light, bounds), torch.tensor([0.5, 0.3, 0.2])
    position, normal = one.mesh.vertices[chosen], one.mesh.normals[chosen]
    first = torch.tensor([1.0, 0, 0]).expand(len(chosen), 3)
    points = SurfacePoints(position, normal, normal, -normal, MeshPoints(chosen[:, None].expand(-1, 3), first))
    occluders = torch.as_tensor(wall, dtype=torch.float32)
    of_sky, sky_visibility = (sky_shadows(backend, hand, them, position) for them in (occluders, NO_OCCLUDERS))
    shadows = light_shadows(backend, hand, samples, occluders, position, of_sky, albedo)
    around = nearby_geometry_of(backend, hand, samples, light)
    assert around is not None
    found = features_with_nearby(around, samples, shadows, sky_visibility, points, backend)
    alone = features_with_nearby(None, samples, shadows, sky_visibility, points, backend)
    torch.testing.assert_close(
        alone.reflected, light_features(samples, shadows, points).reflected, rtol=1e-3, atol=1e-6
    )
    at_points, at_surfels = split_points(sky_visibility, len(position))
    emitted = around.emitted(samples, shadows.surfels)
    near = backend.near_field_light(around.patches, at_points, emitted, points)
    torch.testing.assert_close(found.sky_vectors, alone.sky_vectors + near.sky_vectors)
    surfels = shadows.surfels.surfels
    received = near_on(backend, around.patches, emitted, at_surfels, surfels)
    more = indirect_diffuse_on_mesh(points.hit_points, position, normal, surfels, albedo * received)
    torch.testing.assert_close(found.reflected - alone.reflected, more, rtol=1e-3, atol=1e-5)
    assert more.mean() > 0.01 * near.sky_vectors.abs().mean()


def near_on(backend, patches, emitted, at_surfels, surfels):
    """What the probes receive of patches."""
    seen = SurfacePoints(
        surfels.position, surfels.normal, surfels.normal, -surfels.normal, no_places(len(surfels.chosen))
    )
    vectors = backend.near_field_light(patches, at_surfels, emitted, seen).sky_vectors
    return torch.einsum("pxc,px->pc", vectors, surfels.normal).clamp(min=0)


def no_places(count):
    return MeshPoints(torch.zeros(count, 3, dtype=torch.long), torch.zeros(count, 3))


@pytest.mark.parametrize(("is_finest", "angle_rad"), [(False, 0.0), (True, 0.0), (True, 0.1)])
def test_a_known_surface_casts_the_shadows_of_lamps_and_takes_them(backend, posed, view_from, is_finest, angle_rad):
    """A square between the sun and two points, of which the coarse faces have one half."""
    one = posed("fist")
    hand = HandInView(one.mesh, one.topology, view_from(one.mesh, (0.2, -1, 0.3)))
    centre, radius = Bounds.of(one.mesh)
    corners = centre + radius * torch.tensor([[-0.9, -0.9, 0.5], [0.9, -0.9, 0.5], [0.9, 0.9, 0.5], [-0.9, 0.9, 0.5]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    bones = SurfaceBones(torch.zeros(2, dtype=torch.int8), torch.tensor([[False]]))
    unused = torch.zeros(2, 3, 2), torch.zeros(4), torch.tensor(1.0)
    square = DetailMesh(corners, torch.zeros(4, 3), faces, *unused, bones, faces[:1])
    suns = Lamp("sun", np.ones(3), angle_rad=angle_rad), Lamp("sun", np.ones(3), angle_rad=0.2)
    sun = LightSamples.of(Light(suns), Bounds.of(one.mesh))
    below = centre + radius * torch.tensor([[0.5, -0.5, -0.5], [-0.5, 0.5, -0.5], [0.6, 0.8, 0.9]])
    skin, elsewhere = HitSurface(square, below).shadow_casters(is_finest), torch.zeros(3, 3)
    of_sky = sky_shadows(backend, hand, NO_OCCLUDERS, elsewhere)
    rest = NO_OCCLUDERS, elsewhere, of_sky, torch.ones(3)
    shadows = light_shadows(backend, hand, sun, *rest, shadow_casters=skin)
    lit = [shadows.lamps.lit[sun.lamps.lamp == index].mean(0).tolist() for index in range(2)]
    is_finest_there = is_finest and angle_rad == 0
    assert lit == [[0, 0 if is_finest_there else 1, 1], [0, 1, 1]]
    torch.testing.assert_close(shadows.surfels.of_lamps, light_shadows(backend, hand, sun, *rest).surfels.of_lamps)


def test_light_falls_on_the_normals_of_a_known_surface_where_rays_meet_it():
    field = RelightableField(FieldConfig(planes=((48, 3, 2), (64, 1, 4)), relief=32, light="linear"))
    of_mesh, relief = torch.tensor([0.0, 0, 2]), torch.tensor([0.0, 3, 0])
    channels = torch.zeros(2, field.near_channels + 6)
    channels[:, field.near_channels : field.near_channels + 3] = of_mesh
    channels[:, field.normal_slice] = relief
    composite = Composite(channels.requires_grad_(), torch.ones(2), torch.ones(2), torch.ones(2, 1))
    position, view = torch.zeros(2, 3), torch.tensor([[0.0, 0, -1]] * 2)
    hit_points = MeshPoints(torch.zeros(2, 3, dtype=torch.long), torch.zeros(2, 3))
    hits = RayHits(torch.tensor([0.5, INF]), torch.tensor([[1.0, 0, 0], [0, 0, 0]]))
    points = surface_points(field, composite, position, view, hit_points, hits)
    torch.testing.assert_close(points.normal, torch.tensor([[1.0, 0, 0], [0, 0, 1]]))
    torch.testing.assert_close(points.relief_normal, torch.tensor([[0.0, 1, 0]] * 2))
    assert not points.normal.requires_grad
    assert points.relief_normal.requires_grad  # the field still learns
    unknown = surface_points(field, composite, position, view, hit_points)
    torch.testing.assert_close(unknown.normal, torch.tensor([[0.0, 0, 1]] * 2))


def test_clear_rays_have_the_normal_of_the_surface_that_they_meet():
    """What they gathered is divided by next to nothing; a ray with none of it would get no light."""
    field = RelightableField(FieldConfig(planes=((48, 3, 2), (64, 1, 4)), relief=32, light="linear"))
    alpha, surface = torch.tensor([0.0, 0.5, 0.8, 0.1]), torch.tensor([1.0, 0, 0])
    channels = torch.zeros(4, field.near_channels + 6)
    channels[:, field.normal_slice] = alpha[:, None] * torch.tensor([0.0, 3, 0])
    composite = Composite(channels, alpha, alpha, alpha[:, None])
    rest = torch.zeros(4, 3), torch.zeros(4, 3), MeshPoints(torch.zeros(4, 3, dtype=torch.long), torch.zeros(4, 3))
    hits = RayHits(torch.tensor([0.5, 0.5, 0.5, INF]), surface * torch.tensor([[1.0], [1], [1], [0]]))
    relief_normal = surface_points(field, composite, *rest, hits).relief_normal
    half = 0.5**0.5
    torch.testing.assert_close(relief_normal, torch.tensor([[1.0, 0, 0], [half, half, 0], [0, 1, 0], [0, 1, 0]]))


def test_rays_are_on_the_mesh_unless_a_known_surface_shows_another_part(posed):
    """By 1 mm it is another place of the same part; beside the mesh, or before another part, the surface tells."""
    camera = camera_tensors(Camera(np.eye(3), np.diag([1.0, -1, -1, 1]), SIZE), "cpu")
    mesh = PosedMesh(
        torch.tensor([[-9.0, -9, -0.6], [9, -9, -0.6], [0, 9, -0.6]]), torch.zeros(3, 3), torch.tensor(1.0)
    )
    hand = HandInView(mesh, posed("fist").topology._replace(faces=torch.tensor([[0, 1, 2]])), camera)
    of_mesh = layers([FINGER_M, PALM_M, INF, PALM_M], [INF, INF, INF, INF])
    of_mesh = of_mesh._replace(mesh=of_mesh.mesh._replace(face=torch.tensor([0, 0, -1, 0])))
    hits = RayHits(torch.tensor([FINGER_M + 0.001, FINGER_M, FINGER_M, INF]), torch.zeros(4, 3))
    pixel, directions = torch.arange(4), torch.tensor([[0.0, 0, -1]] * 4)
    rest = pixel, directions, torch.full((4, 2), 0.7), torch.full((4,), 0.1)
    position = ray_positions(hand, of_mesh.first, *rest, hits)
    torch.testing.assert_close(position[:, 2], -torch.tensor([FINGER_M, FINGER_M, FINGER_M, PALM_M]))
    beside = of_mesh.hit_points(hand, of_mesh.first, pixel, position, hits).is_beside
    assert beside.tolist() == [False, True, True, False]
    unknown = ray_positions(hand, of_mesh.first, *rest)
    torch.testing.assert_close(unknown[:, 2], -torch.tensor([FINGER_M, PALM_M, 0.75, PALM_M]))
