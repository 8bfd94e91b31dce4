"""Patches of what stands around a hand: their area, their side, what hides them; and the light they shed."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.capture.varied_light import box_triangles
from livehand.backend.field.rays import HandInView
from livehand.backend.light.indirect_diffuse import MeshPoints, Surfels
from livehand.backend.light.lamp_samples import LampSamples
from livehand.backend.light.lighting import SurfacePoints, SurfelIrradiance
from livehand.backend.light.near_field_light import PatchIrradiance, cell_of, sky_cells
from livehand.backend.light.nearby_geometry import MOST_PATCHES, Patches, PatchPoints
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds, PointShadows
from livehand.backend.light.sky_samples import SKY_DIRECTIONS, SkySamples
from livehand.backend.records.light import Lamp, Light
from livehand.backend.render.light_visibility import nearby_geometry_of
from torch.nn.functional import normalize

RED = np.array([[0.8, 0.2, 0.1]])
SEED = 5


def ball(radius_m=0.1, count=200):
    """Vertices of what stands for a hand, about the origin."""
    generator = torch.Generator().manual_seed(SEED)
    return radius_m * normalize(torch.randn(count, 3, generator=generator), dim=-1)


def wall(height_m, half_m=0.4, thickness_m=0.01):
    """A box above or below the origin."""
    return box_triangles(np.array([0, 0, height_m]), np.eye(3), np.array([half_m, half_m, thickness_m / 2]))


def around(*boxes):
    triangles = np.concatenate(boxes)
    return Patches.around(Light(occluders=triangles, occluder_albedo=np.repeat(RED, len(triangles), 0)), ball())


def flat_patches(position, normal, area_m2, albedo):
    """Patches, each its own point."""
    points = PatchPoints(position, normal, area_m2, torch.arange(len(position)))
    return Patches(position, normal, area_m2, albedo, points)


def dark_skin():
    """A hand that sheds no light."""
    one = torch.zeros(1, 3)
    surfels = Surfels(one, torch.tensor([[0.0, 0, 1]]), torch.tensor([0]), torch.ones(1))
    return SurfelIrradiance(surfels, torch.zeros(3), torch.zeros(SKY_DIRECTIONS, 1), torch.zeros(1, 1))


def test_patches_have_the_area_that_the_hand_sees_and_face_it():
    """Of a wall, its near side alone: 0.8 x 0.8 m, a little before the surface."""
    patches = around(wall(-0.3))
    assert 4 < len(patches.position) <= MOST_PATCHES
    assert float(patches.area_m2.sum()) == pytest.approx(0.64, rel=0.01)
    torch.testing.assert_close(patches.normal, torch.tensor([[0.0, 0, 1]]).expand_as(patches.normal))
    np.testing.assert_allclose(patches.position[:, 2], -0.3 + 0.005 + 0.0015, atol=6e-4)
    np.testing.assert_allclose(patches.albedo, np.repeat(RED, len(patches.albedo), 0), atol=1e-6)


def test_what_a_screen_hides_is_left_out():
    """A larger wall behind: only what looks past the nearer one."""
    near, far = around(wall(-0.3)), around(wall(-0.3), wall(-0.5))
    assert float(far.area_m2.sum()) == pytest.approx(float(near.area_m2.sum()), rel=0.15)


def test_the_order_of_corners_does_not_matter():
    """A table seen from below would be lit on the wrong side."""
    for ours, theirs in zip(around(wall(-0.3)), around(wall(-0.3)[:, ::-1]), strict=True):
        torch.testing.assert_close(ours, theirs)


def test_a_screen_hides_what_lies_behind_its_triangle_alone():
    """Half of a square between wall and hand; one beyond the hand, or beyond the wall, hides nothing."""
    half = np.array([[[-0.6, -0.6, 0], [0.6, -0.6, 0], [-0.6, 0.6, 0]]])
    bare = float(around(wall(-0.5)).area_m2.sum())
    for height_m, seen in ((-0.4, 0.5), (0.4, 1), (-0.6, 1)):
        patches = around(wall(-0.5), half + np.array([0, 0, height_m]))
        is_wall = (patches.position[:, 2] + 0.5).abs() < 0.02
        assert float(patches.area_m2[is_wall].sum()) == pytest.approx(seen * bare, rel=0.2), height_m


def test_a_dense_mesh_and_a_great_floor_are_few_patches():
    grid = np.linspace(-3, 3, 61)
    x, y = (values.ravel() for values in np.meshgrid(grid[:-1], grid[:-1]))
    corner = np.stack([x, y, np.full_like(x, -0.4)], -1)
    right, up = np.array([0.1, 0, 0]), np.array([0, 0.1, 0])
    dense = np.concatenate(
        [np.stack([corner, corner + a, corner + b], 1) for a, b in ((right, right + up), (right + up, up))]
    )
    square = 3 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) - [0, 0, 0.4]
    for triangles in (dense, square[[[0, 1, 2], [0, 2, 3]]]):
        patches = around(triangles)
        assert 10 < len(patches.position) <= MOST_PATCHES
        # A floor of 6 m from 0.4 m above: all but the share of the sky beyond its edge.
        _, factors, _ = patches.factors(torch.zeros(1, 3))
        cosine = (normalize(patches.position, dim=-1) * torch.tensor([0.0, 0, -1])).sum(-1)
        assert float((factors[0] * cosine).sum()) == pytest.approx(0.97, abs=0.06)


def test_black_things_and_nothing_are_no_patches():
    assert len(Patches.around(Light(occluders=wall(-0.3)), ball()).position) == 0
    assert len(Patches.around(Light(), ball()).position) == 0


def test_patches_shed_what_they_receive_and_exchange():
    """Two that face each other: of the light on one, the other sheds back the share of its form factor."""
    position = torch.tensor([[0.0, 0, 0], [0, 0, 0.2]])
    normal, albedo = torch.tensor([[0.0, 0, 1], [0, 0, -1]]), torch.tensor([[0.5, 0.5, 0.5], [0.4, 0.2, 0.1]])
    patches = flat_patches(position, normal, torch.full((2,), 0.01), albedo)
    factor = 0.01 / (pi * 0.04 + 0.01)
    torch.testing.assert_close(patches.exchanged(), torch.tensor([[0, factor], [factor, 0]]))


@pytest.fixture
def seen():
    """Points on a ball, patches below them, half of the sky hidden at each at random, and radiance."""
    generator = torch.Generator().manual_seed(SEED)
    normal = normalize(torch.randn(300, 3, generator=generator), dim=-1)
    relief = normalize(normal + 0.2 * torch.randn(300, 3, generator=generator), dim=-1)
    view = normalize(torch.randn(300, 3, generator=generator) - 2 * normal, dim=-1)
    spots = MeshPoints(torch.zeros(300, 3, dtype=torch.long), torch.zeros(300, 3))
    lit = (torch.rand(SKY_DIRECTIONS, 300, generator=generator) > 0.5).float()
    points = SurfacePoints(0.1 * normal, normal, relief, view, spots)
    patches = around(wall(-0.2))
    emitted = torch.rand(len(patches.position), 3, generator=generator)
    return patches, PointShadows(lit, torch.zeros_like(lit)), emitted, points


@pytest.mark.slow
def test_both_backends_agree(backend_pair, seen):
    for ours, theirs in zip(*(backend.near_field_light(*seen) for backend in backend_pair), strict=True):
        assert theirs.abs().max() > 0
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-3)


def test_an_even_wall_is_as_bright_as_its_form_factor(backend, seen):
    """Below a small surface that faces it, a square of half side a at distance h; nothing on one that faces away."""
    patches, _, emitted, points = seen
    down = torch.tensor([[0.0, 0, -1], [0, 0, 1]])
    two = SurfacePoints(
        torch.zeros(2, 3), down, down, -down, MeshPoints(points.hit_points.vertex[:2], points.hit_points.weight[:2])
    )
    clear = PointShadows(torch.ones(SKY_DIRECTIONS, 2), torch.zeros(SKY_DIRECTIONS, 2))
    found = backend.near_field_light(patches, clear, torch.ones_like(emitted), two)
    light = torch.einsum("rxc,rx->rc", found.sky_vectors, down).clamp(min=0)
    ratio = 0.4 / (0.2 - 0.006)  # of half side and distance
    expected = 4 / pi * ratio / (1 + ratio**2) ** 0.5 * np.arctan(ratio / (1 + ratio**2) ** 0.5)
    np.testing.assert_allclose(light[0], expected, rtol=0.05)
    assert light[1].max() == 0
    assert found.near_field_specular[0].min() > 0.5 * 0.028 * expected
    hidden = backend.near_field_light(
        patches, PointShadows(0 * clear.lit, clear.depth_in_m), torch.ones_like(emitted), two
    )
    assert max(float(value.abs().max()) for value in hidden) == 0


def test_cells_hold_the_nearest_direction_of_the_sky():
    """But for those near borders."""
    directions = normalize(torch.randn(2000, 3, generator=torch.Generator().manual_seed(SEED)), dim=-1)
    towards = SkySamples.of(None, "cpu").towards
    cells, weights = sky_cells(torch.device("cpu"))
    assert (weights.diff(dim=1) <= 0).all()
    torch.testing.assert_close(weights.sum(1), torch.ones(len(weights)))
    found = towards[cells[cell_of(directions), 0]]
    nearest = (directions @ towards.T).amax(1)
    assert ((found * directions).sum(-1) > nearest - 0.1).all()
    assert ((found * directions).sum(-1) > nearest - 1e-6).float().mean() > 0.75


def test_a_patch_is_hidden_little_by_little(backend):
    """Around a hidden half of the sky a patch fades with its direction; it does not switch."""
    towards = SkySamples.of(None, "cpu").towards
    lit = (towards[:, 2] > 0).float()[:, None]
    angle = torch.linspace(-0.5, 0.5, 81)
    directions = torch.stack([angle.cos(), torch.zeros(81), angle.sin()], 1)
    point = SurfacePoints(
        torch.zeros(1, 3),
        *(torch.tensor([[1.0, 0, 0]]),) * 2,
        torch.tensor([[-1.0, 0, 0]]),
        MeshPoints(torch.zeros(1, 3, dtype=torch.long), torch.zeros(1, 3)),
    )
    light = []
    for direction in directions:
        patch = flat_patches(direction[None], -direction[None], torch.tensor([1e-4]), torch.ones(1, 3))
        near = backend.near_field_light(patch, PointShadows(lit, 0 * lit), torch.full((1, 3), 1e4 * pi), point)
        light.append(float(near.sky_vectors[0, :, 0].norm()))
    assert light[0] < 0.2
    assert light[-1] > 0.8
    assert np.abs(np.diff(light)).max() < 0.3


def test_patches_shed_light_a_second_time():
    """One in a lamp's light; of what it sheds, the other sheds its albedo's share of its form factor's."""
    position, normal = torch.tensor([[0.0, 0, 0], [0, 0, 0.2]]), torch.tensor([[0.0, 0, 1], [0, 0, -1]])
    patches = flat_patches(position, normal, torch.full((2,), 0.01), torch.tensor([[0.5, 0.5, 0.5], [0.4, 0.2, 0.1]]))
    lamp = LampSamples.of((Lamp("sun", np.array([1.0, 2, 3])),), Bounds(torch.zeros(3), torch.tensor(0.1)))
    of_sky = torch.zeros(SKY_DIRECTIONS, 2)
    emitted = PatchIrradiance(patches, of_sky, torch.tensor([[1.0, 0]]).expand(len(lamp.rgb), 2)).emitted(
        LightSamples(SkySamples.of(None, "cpu"), lamp), dark_skin()
    )
    direct = 0.5 * lamp.rgb.sum(0)
    torch.testing.assert_close(emitted[0], direct)
    torch.testing.assert_close(emitted[1], torch.tensor([0.4, 0.2, 0.1]) * 0.01 / (pi * 0.04 + 0.01) * direct)


def test_light_on_patches_adds_up_in_lamps_and_sky():
    patches = around(wall(-0.3))
    count = len(patches.position)
    bounds = Bounds(torch.zeros(3), torch.tensor(0.1))
    lamps = LampSamples.of((Lamp("sun", np.array([1.0, 2, 3])),), bounds)
    sky = SkySamples.of(None, "cpu")._replace(flux=torch.full((SKY_DIRECTIONS, 3), 0.1))
    light = PatchIrradiance(patches, torch.rand(SKY_DIRECTIONS, count), torch.rand(1, count))
    dark = sky._replace(flux=0 * sky.flux)
    both, one, other = (
        light.emitted(LightSamples(s, lamp), dark_skin())
        for s, lamp in ((sky, lamps), (sky, lamps._replace(rgb=0 * lamps.rgb)), (dark, lamps))
    )
    torch.testing.assert_close(both, one + other)


def test_a_wall_that_the_hand_reaches_through_is_seen_from_both_sides():
    """Wholly, though the nearest of the hand lies behind much of it."""
    patches = around(wall(0.02))
    for side in (1, -1):
        of_side = (patches.normal[:, 2] * side > 0.99) & ((patches.position[:, 2] - 0.02) * side > 0.005)
        assert float(patches.area_m2[of_side].sum()) == pytest.approx(0.64, rel=0.05)


def test_points_lie_on_their_patches_and_have_their_area():
    patches = around(wall(-0.3), wall(0.02))
    points, count = patches.points, len(patches.position)
    assert len(points.position) > 2 * count
    area = torch.zeros(count).index_add(0, points.patch, points.area_m2)
    torch.testing.assert_close(area, patches.area_m2, rtol=1e-3, atol=1e-9)
    middle = patches.mean(points.position.T).T
    across = middle - patches.position - ((middle - patches.position) * patches.normal).sum(-1, True) * patches.normal
    assert across.norm(dim=-1).max() < 1e-5
    torch.testing.assert_close(patches.mean(torch.ones(2, len(points.patch))), torch.ones(2, count))


@pytest.mark.parametrize("edge_m", [-0.11, 0.0, 0.07])
def test_a_shadow_ends_within_a_patch(backend, spheres, view_from, edge_m):
    """Half a wall of 0.8 m in a sun that shines straight on it, but for what stands before the sun."""
    mesh, topology = spheres(((0, 0, 0.3), 0.02))
    hand = HandInView(mesh, topology, view_from(mesh, (0.2, -1, 0.3)))
    board = np.array([[[edge_m, -9, 1.0], [edge_m, 9, 1.0], [-9, 0, 1.0]]])
    triangles = np.concatenate([wall(-0.1), board])
    sun = Lamp("sun", np.full(3, pi), rotation=np.eye(3))
    light = Light((sun,), None, triangles, np.repeat([[0.5, 0.5, 0.5], [0, 0, 0]], [12, 1], 0))
    emitted = nearby_geometry_of(backend, hand, LightSamples.of(light, Bounds.of(mesh)), light)
    assert emitted is not None
    of_sun = emitted.of_lamps.sum(0) / emitted.of_lamps.sum(0).max()
    lit = (of_sun * emitted.patches.area_m2)[emitted.patches.normal[:, 2] > 0.99].sum()
    assert float(lit) == pytest.approx(0.8 * (0.4 - edge_m), rel=0.04)


def test_the_hand_lights_what_stands_around(backend):
    """A disc of skin before a patch: its radiance by its form factor, and the patch's albedo of that."""
    patches = flat_patches(
        *torch.tensor([[[0.0, 0, 0]], [[0.0, 0, 1]]]), torch.tensor([0.01]), torch.tensor(RED).float()
    )
    disc = Surfels(torch.tensor([[0.0, 0, 0.3]]), torch.tensor([[0.0, 0, -1]]), torch.tensor([0]), torch.tensor([0.02]))
    lamp = LampSamples.of((Lamp("sun", np.array([1.0, 2, 3])),), Bounds(torch.zeros(3), torch.tensor(0.1)))
    light = LightSamples(SkySamples.of(None, "cpu"), lamp)
    skin = SurfelIrradiance(
        disc, torch.tensor([0.7, 0.5, 0.4]), torch.zeros(SKY_DIRECTIONS, 1), torch.ones(len(lamp.rgb), 1)
    )
    around_it = PatchIrradiance(patches, torch.zeros(SKY_DIRECTIONS, 1), torch.zeros(len(lamp.rgb), 1))
    expected = (
        0.02 / (pi * 0.09 + 0.02) * torch.tensor(RED[0]).float() * torch.tensor([0.7, 0.5, 0.4]) * lamp.rgb.sum(0)
    )
    torch.testing.assert_close(around_it.emitted(light, skin, backend.indirect_diffuse)[0], expected)
