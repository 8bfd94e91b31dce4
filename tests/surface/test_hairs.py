"""Hairs on a lit image: areas and energies that are known, what hides them, and how they lie over the skin."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import camera_tensors
from livehand.backend.light.lighting import LightFeatures
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment
from livehand.backend.records.camera import Camera
from livehand.backend.surface.detail_mesh import DetailMesh
from livehand.backend.surface.edge_antialiasing import SurfaceBones
from livehand.backend.surface.hair_growth import Hairs
from livehand.backend.surface.hairs import (
    ABOVE_SKIN_M,
    ALBEDO,
    EVEN,
    REFLECTED,
    SEGMENTS,
    PosedHairs,
    VisibleHairs,
    hair_albedo,
    hair_colours,
    visible_hairs,
    with_hairs,
)

SIZE, FOCAL_PX, DEPTH_M = (40, 32), 1000.0, 0.5
EVERY_RAY = torch.arange(SIZE[0] * SIZE[1] // 4)
NOWHERE = torch.full((SIZE[1], SIZE[0]), torch.inf)


def camera():
    """Looks along z, at the origin from `DEPTH_M`."""
    cam2world = np.eye(4)
    cam2world[2, 3] = -DEPTH_M
    K = np.array([[FOCAL_PX, 0, SIZE[0] / 2], [0, FOCAL_PX, SIZE[1] / 2], [0, 0, 1]])
    return camera_tensors(Camera(K, cam2world, SIZE), "cpu")


def one_hair(start=(-0.004, -0.002, 0.0), way=(0.008, 0.003, 0.0), radius_m=4e-5):
    t = torch.linspace(0, 1, SEGMENTS + 1)[:, None]
    points = (torch.tensor(start) + t * torch.tensor(way))[None]
    up, albedo = torch.tensor([[0.0, 0, -1]]), torch.tensor([0.2, 0.1, 0.05])
    return PosedHairs(points, up, torch.tensor([radius_m]), albedo, torch.tensor(ABOVE_SKIN_M))


def features(count, towards=(0.0, 0, -1), strength=1.0, sky=0.0, reflected=0.0, arriving=1.0):
    """A lamp of one colour from a direction, and even light."""
    return LightFeatures(
        lamp_vectors=(strength * torch.tensor(towards)).expand(count, 1, 3),
        lamp_rgb=torch.tensor([[1.0, 2, 3]]),
        lamp_radius_rad=torch.zeros(1),
        sky_vectors=(sky * torch.tensor([0.0, 0, -1]))[:, None].expand(count, 3, 3),
        lobe_visibility=torch.zeros(count, 2),
        mirrored=PrefilteredEnvironment.of(None, "cpu"),
        near_field_specular=torch.zeros(count, 2, 3),
        scattered=torch.zeros(count, 2, 3),
        arriving=torch.full((count, 3), arriving),
        reflected=torch.full((count, 3), reflected),
    )


def test_hairs_follow_the_face_on_which_they_grow():
    """A face that is turned, twice as large: the root in its middle, a side's length along it, and up by its normal."""
    vertices = torch.tensor([[0.0, 0, 0], [0, 2, 0], [0, 0, 2]])
    normals, faces = torch.tensor([[1.0, 0, 0]]).expand(3, 3), torch.tensor([[0, 1, 2]])
    bones = SurfaceBones(torch.zeros(1, dtype=torch.int8), torch.tensor([[False]]))
    mesh = DetailMesh(vertices, normals, faces, torch.zeros(1, 3, 2), torch.zeros(3), torch.tensor(2.0), bones, faces)
    hairs = Hairs(
        faces.numpy(), np.full((1, 3), 1 / 3), np.array([[1.0, 0, 0.5]]), np.array([[0, 1, -0.5]]), np.ones(1)
    )
    posed = PosedHairs.of(hairs, mesh, (0.1, 0.2, 0.3))
    root, t = torch.tensor([0, 2 / 3, 2 / 3]), torch.linspace(0, 1, SEGMENTS + 1)[:, None]
    expected = root + t * torch.tensor([1.0, 2, 0]) + t * t * torch.tensor([-1.0, 0, 2])
    torch.testing.assert_close(posed.points[0], expected)
    torch.testing.assert_close(posed.normal, torch.tensor([[1.0, 0, 0]]))
    assert (float(posed.radius_m), float(posed.behind_m)) == pytest.approx((2, 2 * ABOVE_SKIN_M))


@pytest.mark.parametrize("way", [(0.008, 0.003, 0.0), (0.0, 0.006, 0.0), (0.003, 0.0, -0.004)])
def test_pixels_show_the_area_of_a_hair_that_thins_to_its_tip(way):
    seen = visible_hairs(one_hair(way=way), camera(), NOWHERE, EVERY_RAY)
    length_px = np.hypot(*way[:2]) * FOCAL_PX / DEPTH_M
    assert float(seen.area.sum()) == pytest.approx(4e-5 * FOCAL_PX / DEPTH_M * length_px, rel=0.01)
    by_pixel = torch.zeros(SIZE[0] * SIZE[1]).index_add(0, seen.pixel.flatten(), seen.area.flatten())
    assert by_pixel.max() < 2 * 2 * 4e-5 * FOCAL_PX / DEPTH_M


def test_a_hair_covers_the_pixels_that_it_crosses_and_no_others():
    seen = visible_hairs(one_hair(start=(-0.005, 0.00025, 0), way=(0.01, 0, 0)), camera(), NOWHERE, EVERY_RAY)
    image = torch.zeros(SIZE[0] * SIZE[1]).index_add(0, seen.pixel.flatten(), seen.area.flatten()).reshape(SIZE[::-1])
    assert image[16, 10:30].min() > 0
    assert image[:16].max() + image[17:].max() < 1e-6


def test_an_orthographic_camera_sees_every_hair_along_its_axis():
    """As large as it is seen from `DEPTH_M`, where it lies."""
    K = torch.diag(torch.tensor([1 / DEPTH_M, 1 / DEPTH_M, 1])) @ camera().K
    K[:2, 2] = camera().K[:2, 2]
    seen, near = (
        visible_hairs(one_hair(), one, NOWHERE, EVERY_RAY)
        for one in (camera()._replace(K=K, is_orthographic=True), camera())
    )
    torch.testing.assert_close(seen.view, torch.tensor([0.0, 0, 1]).expand(SEGMENTS, 3))
    assert (near.view[:, :2].abs() > 1e-3).any()
    torch.testing.assert_close(seen.pixel, near.pixel)
    torch.testing.assert_close(seen.area, near.area, rtol=1e-3, atol=1e-5)


def test_a_hair_beside_the_image_does_not_come_in_on_the_other_side():
    leaving = visible_hairs(one_hair(start=(0.008, 0.0, 0.0), way=(0.008, 0, 0)), camera(), NOWHERE, EVERY_RAY)
    assert (leaving.pixel % SIZE[0]).min() > SIZE[0] // 2
    within = 0.4375 * 4e-5 * (FOCAL_PX / DEPTH_M) ** 2 * 0.008  # a quarter of its length, where it is thickest
    assert float(leaving.area.sum()) == pytest.approx(within, rel=0.03)


@pytest.mark.parametrize(("before_m", "share"), [(0.0, 1.0), (-0.0001, 1.0), (-0.001, 0.0), (0.1, 1.0)])
def test_skin_hides_what_is_behind_it(before_m, share):
    skin = torch.full((SIZE[1], SIZE[0]), DEPTH_M + before_m)
    whole = visible_hairs(one_hair(), camera(), NOWHERE, EVERY_RAY).area.sum()
    found = visible_hairs(one_hair(), camera(), skin, EVERY_RAY)
    assert float(found.area.sum() / whole) == pytest.approx(share, abs=1e-5)
    torch.testing.assert_close(found.depth, skin)


def test_hairs_end_before_the_camera():
    beside_it = one_hair(start=(0.0, 0.0, -DEPTH_M + 0.01), way=(0.0001, 0, -0.02))
    assert len(visible_hairs(beside_it, camera(), NOWHERE, EVERY_RAY).piece) == 0


def test_depth_beside_the_skin_is_that_of_hairs():
    seen = visible_hairs(one_hair(), camera(), NOWHERE, EVERY_RAY)
    on_hair = torch.zeros(SIZE[0] * SIZE[1], dtype=torch.bool).index_fill(
        0, seen.pixel[(seen.area > 0).all(1)].flatten(), True
    )
    torch.testing.assert_close(seen.depth.flatten()[on_hair], torch.full((int(on_hair.sum()),), DEPTH_M))
    assert seen.depth.isinf().any()


def test_hairs_whose_root_no_ray_meets_are_not_drawn():
    assert len(visible_hairs(one_hair(), camera(), NOWHERE, EVERY_RAY[:40]).piece) == 0
    hair = one_hair()
    none = hair._replace(points=hair.points[:0], normal=hair.normal[:0], radius_m=hair.radius_m[:0])
    assert len(visible_hairs(none, camera(), NOWHERE, EVERY_RAY).piece) == 0


def around(count):
    """Views [n, 3] from the camera, evenly over the sphere, and the solid angle of each."""
    height = (torch.arange(count) + 0.5) / count * 2 - 1
    turn = torch.arange(count) * pi * (3 - 5**0.5)
    ring = (1 - height * height).sqrt()
    return torch.stack([ring * turn.cos(), ring * turn.sin(), height], 1), 4 * pi / count


@pytest.mark.parametrize("sine_in", [0.0, 0.5])
def test_a_hair_reflects_its_albedo_and_mirrors_its_share(sine_in):
    """Of what falls on a unit of length; what leaves it is radiance times the sine of its angle to the hair."""
    view, solid = around(40000)
    tangent, albedo = torch.tensor([[0.0, 0, 1]]).expand(len(view), 3), torch.tensor([0.0, 0.5, 1])
    towards = (float((1 - sine_in**2) ** 0.5), 0.0, sine_in)
    lit = hair_colours(features(len(view), towards), tangent, -view, view, albedo) / torch.tensor([1.0, 2, 3])
    leaving = (lit * (1 - view[:, 2:] ** 2).sqrt()).sum(0) * solid
    falling = pi * (1 - sine_in**2) ** 0.5
    torch.testing.assert_close(leaving / falling, REFLECTED + albedo, atol=0.02 * float(albedo.max()), rtol=0)
    assert float(leaving[0] / falling) == pytest.approx(REFLECTED, rel=0.08)  # the cone is not narrow


def test_a_hair_shines_where_it_mirrors_the_lamp_and_is_dark_from_behind():
    tangent = torch.tensor([[0.0, 0, 1]])
    towards = (0.8, 0.0, 0.6)

    def view_from(*eye):
        return float(hair_colours(features(1, towards), tangent, tangent, -torch.tensor([eye]), torch.zeros(3))[0, 0])

    assert view_from(0.8, 0.0, -0.6) > 20 * view_from(0.8, 0.0, 0.6) > 0
    assert view_from(0.8, 0.0, -0.6) > 5 * view_from(-0.78, 0.18, -0.6)


def test_even_light_is_as_bright_as_hair_and_what_was_measured_scales_all():
    up = torch.tensor([[0.0, 0, -1]])
    along = torch.tensor([[1.0, 0, 0]])
    albedo = torch.tensor([0.1, 0.2, 0.3])
    even = hair_colours(features(1, strength=0.0, sky=0.5, reflected=0.25), along, up, -up, albedo)
    torch.testing.assert_close(even[0], EVEN * (albedo + REFLECTED) * 0.75)
    lamp = hair_colours(features(1), along, up, -up, albedo)
    torch.testing.assert_close(hair_colours(features(1, arriving=0.5), along, up, -up, albedo), 0.5 * lamp)


def seen_as(area, size=(2, 2)):
    """Two pieces that cover the first pixel by these areas."""
    points = torch.zeros(2, 4, dtype=torch.long)
    areas = torch.tensor([[area, 0, 0, 0], [area, 0, 0, 0]])
    across = torch.tensor([[1.0, 0, 0]]).expand(2, 3)
    up = torch.tensor([[0.0, 0, -1]]).expand(2, 3)
    return VisibleHairs(
        torch.arange(2),
        points,
        areas,
        across,
        up,
        -up,
        torch.zeros(2, dtype=torch.long),
        torch.ones(3),
        torch.ones(size),
    )


@pytest.mark.parametrize(("area", "share"), [(0.0, 0.0), (0.2, 0.4), (0.8, 1.0)])
@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_hairs_lie_over_the_skin_and_beside_it(area, share, alpha):
    light = features(1, strength=0.0, reflected=1.0)
    skin = torch.full((3, 2, 2), 0.3 * alpha)
    colours, found = with_hairs(skin, torch.full((2, 2), alpha), seen_as(area), light)
    of_hair = EVEN * (1 + REFLECTED)
    torch.testing.assert_close(colours[:, 0, 0], torch.full((3,), (1 - share) * 0.3 * alpha + share * of_hair))
    assert float(found[0, 0]) == pytest.approx(alpha + share * (1 - alpha))
    torch.testing.assert_close(colours[:, 1], skin[:, 1])
    torch.testing.assert_close(found[1], torch.full((2,), alpha))


def test_light_is_taken_from_the_ray_at_the_root():
    rays = features(2, strength=0.0, reflected=1.0)
    rays = rays._replace(reflected=rays.reflected * torch.tensor([[1.0], [3.0]]))
    first, second = (
        with_hairs(torch.zeros(3, 2, 2), torch.zeros(2, 2), seen_as(0.2)._replace(ray=torch.tensor([ray, ray])), rays)[
            0
        ]
        for ray in (0, 1)
    )
    torch.testing.assert_close(3 * first, second)


def test_hairs_are_as_dark_as_the_skin_is_deep():
    assert (hair_albedo(0.0), hair_albedo(1.0)) == (pytest.approx(ALBEDO[0]), pytest.approx(ALBEDO[1]))
    assert hair_albedo(1.2) == hair_albedo(1.0)
    assert hair_albedo(0.5) == pytest.approx(np.mean(ALBEDO, 0))
