"""Bent normals: closed forms of what remains of a light, and mirrored views that leave the surface."""

import math

import numba
import numpy as np
import pytest
import torch
from livehand.backend.compute.kernels import brdf
from livehand.backend.light.brdf import (
    LEAST_MIRRORED,
    STEEPER,
    bump_shadowing,
    clamped_reflection_normal,
    glossy_normal,
    horizon_occlusion,
)
from livehand.backend.surface.detail_maps import BUMP
from torch.nn.functional import normalize

UP = torch.tensor([0.0, 0, 1])


def tilted(degrees):
    """Unit vectors, turned from the surface's normal towards +x."""
    angle = torch.deg2rad(torch.as_tensor(degrees, dtype=torch.float32))
    return torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)


def random_units(count, seed):
    return normalize(torch.randn(count, 3, generator=torch.Generator().manual_seed(seed)), dim=-1)


def mirrored_cosine(normal, view):
    """Of the mirrored view and the surface."""
    return (view - 2 * (normal * view).sum(-1, keepdim=True) * normal)[..., 2]


def test_a_normal_that_is_not_bent_receives_all_that_it_faces():
    normal, towards = random_units(500, 0), random_units(500, 1)
    facing = (normal * towards).sum(-1) > 0.01
    torch.testing.assert_close(bump_shadowing(normal, normal, towards)[facing], torch.ones(int(facing.sum())))


@pytest.mark.parametrize("bend_degrees", [10.0, 40.0])
def test_what_remains_is_the_cubic_of_the_quotient_of_cosines(bend_degrees):
    normal = tilted(bend_degrees)
    for light_degrees in (0.0, 30.0, 60.0, 80.0, 89.0):
        quotient = math.cos(math.radians(light_degrees)) / (
            math.cos(math.radians(light_degrees - bend_degrees)) * math.cos(math.radians(bend_degrees))
        )
        expected = 1.0 if quotient >= 1 else quotient + quotient**2 - quotient**3
        found = bump_shadowing(normal, UP, tilted(light_degrees))
        torch.testing.assert_close(found, torch.tensor(expected), atol=1e-5, rtol=0)


def test_a_bump_does_not_shine_beyond_the_terminator():
    assert bump_shadowing(tilted(30.0), UP, tilted(91.0)) == 0
    assert 0 < bump_shadowing(tilted(30.0), UP, tilted(89.0)) < 0.1


def test_normals_that_mirror_the_view_outwards_stay():
    normal, view = normalize(UP + 0.2 * random_units(200, 2), dim=-1), -tilted(20.0).expand(200, 3)
    assert mirrored_cosine(normal, view).min() > LEAST_MIRRORED
    assert torch.equal(clamped_reflection_normal(normal, UP.expand(200, 3), view), normal)


def test_others_are_bent_back_until_the_mirrored_view_grazes_the_surface():
    normal, view = random_units(4000, 3), -random_units(4000, 4)
    normal, view = (torch.cat([v[:, :2], sign * v[:, 2:].abs()], 1) for v, sign in ((normal, 1), (view, -1)))
    found = clamped_reflection_normal(normal, UP.expand_as(normal), view)
    before, after = mirrored_cosine(normal, view), mirrored_cosine(found, view)
    into = before < LEAST_MIRRORED
    assert 1000 < into.sum() < 3000
    least = (0.9 * -view[:, 2]).clamp(max=LEAST_MIRRORED)
    torch.testing.assert_close(after[into], least[into], atol=2e-5, rtol=0)
    torch.testing.assert_close(found.norm(dim=1), torch.ones(4000))
    # Within the plane of both normals, and no farther from the surface's than before.
    off_plane = (found * torch.linalg.cross(normal, UP.expand_as(normal))).sum(-1)
    torch.testing.assert_close(off_plane, torch.zeros(4000), atol=1e-5, rtol=0)
    assert (found[:, 2] > normal[:, 2])[into].all()


def test_a_surface_that_faces_away_and_equal_normals_change_nothing_and_have_finite_gradients():
    normal = torch.stack([UP, UP, tilted(60.0), tilted(60.0)]).requires_grad_()
    view = torch.stack([-UP, -tilted(90.0), tilted(30.0), torch.tensor([1.0, 0, 0])])
    found = clamped_reflection_normal(normal, UP.expand(4, 3), view)
    assert torch.equal(found, normal)
    found.sum().backward()
    assert torch.equal(normal.grad, torch.ones(4, 3))


@pytest.mark.parametrize("bend_degrees", [0.0, 10.0, 40.0])
def test_gloss_of_lamps_shows_steeper_slopes(bend_degrees):
    found = glossy_normal(tilted(bend_degrees)[None], UP[None])[0]
    tangent = STEEPER * math.tan(math.radians(bend_degrees))
    torch.testing.assert_close(found, tilted(math.degrees(math.atan(tangent))))


def test_slopes_that_normals_show_less_of_are_whole_in_gloss_of_lamps():
    assert pytest.approx(1 / BUMP) == STEEPER


def test_all_of_a_lobe_leaves_a_surface_without_bumps():
    view = -tilted(torch.tensor([0.0, 40.0, 80.0, 89.9]))
    found = horizon_occlusion(UP.expand(4, 3), UP.expand(4, 3), view, torch.tensor([[0.01, 0.09]]).expand(4, 2))
    torch.testing.assert_close(found, torch.ones(4, 2))


@pytest.mark.parametrize(("bend_degrees", "elevation_degrees"), [(45.0, 0.0), (30.0, 30.0), (40.0, 10.0)])
def test_of_a_lobe_around_a_mirrored_view_what_runs_into_the_surface_is_lost(bend_degrees, elevation_degrees):
    """Seen along the surface's normal; the lobe as half vectors whose tilt in that plane is as GGX has it."""
    alpha, count = 0.3, 200001
    drawn = (torch.arange(count, dtype=torch.float64) + 0.5) / count
    slope = alpha * (drawn - 0.5) / (drawn * (1 - drawn)).sqrt()
    tilt = torch.rad2deg(2 * torch.atan(slope))
    above_surface, above_bump = ((tilt < limit).double().mean() for limit in (elevation_degrees, 90 - bend_degrees))
    found = horizon_occlusion(tilted(bend_degrees)[None], UP[None], -UP[None], torch.tensor([[alpha**2]]))
    assert float(found) == pytest.approx(float(above_surface / above_bump), abs=1e-3)


def test_bumps_that_face_the_eye_keep_their_lobe():
    assert horizon_occlusion(tilted(30.0)[None], UP[None], -tilted(60.0)[None], torch.tensor([[0.09]])) == 1


COUNT = 2000


def along(normal, surface):
    return (normal * surface).sum(-1).numpy()


@numba.njit
def bent_back(normal, surface_normal, view, along, out):
    """Only kernels can call parts of kernels."""
    brdf.clamped_reflection_normal(normal, surface_normal, view, along, out)


@numba.njit
def steepened(normal, surface_normal, along, out):
    return brdf.glossy_normal(normal, surface_normal, along, out)


@numba.njit
def shadowed(facing, x, y, z, along, surface_normal):
    return brdf.bump_shadowing(facing, x, y, z, along, surface_normal)


@numba.njit
def occluded(above, to_eye, alpha_squared):
    return brdf.horizon_occlusion(above, to_eye, alpha_squared)


def test_normals_are_bent_back_as_by_the_reference():
    surface, view = random_units(COUNT, 0), random_units(COUNT, 1)
    normal = normalize(surface + 0.7 * random_units(COUNT, 2), dim=-1)
    expected, found = clamped_reflection_normal(normal, surface, view), np.empty((COUNT, 3), np.float32)
    for index, row in enumerate(
        zip(normal.numpy(), surface.numpy(), view.numpy(), along(normal, surface), strict=True)
    ):
        bent_back(*row, found[index])
    assert 300 < (expected != normal).any(1).sum() < COUNT - 300
    torch.testing.assert_close(torch.as_tensor(found), expected, atol=2e-5, rtol=0)


def test_slopes_are_steeper_as_by_the_reference():
    surface = random_units(COUNT, 6)
    normal = normalize(surface + 0.7 * random_units(COUNT, 7), dim=-1)
    expected, found = glossy_normal(normal, surface), np.empty((COUNT, 3), np.float32)
    rows = zip(normal.numpy(), surface.numpy(), along(normal, surface), found, strict=True)
    cosines = [steepened(*row) for row in rows]
    torch.testing.assert_close(torch.as_tensor(found), expected, atol=2e-5, rtol=0)
    np.testing.assert_allclose(cosines, along(expected, surface), atol=2e-5)


def test_what_remains_of_a_light_is_that_of_the_reference():
    surface, towards = random_units(COUNT, 3), random_units(COUNT, 4)
    normal = normalize(surface + 0.7 * random_units(COUNT, 5), dim=-1)
    facing = along(normal, towards)
    rows = zip(facing, *towards.numpy().T, along(normal, surface), surface.numpy(), strict=True)
    found = torch.tensor([shadowed(*row) for row in rows])
    torch.testing.assert_close(found, bump_shadowing(normal, surface, towards), atol=1e-4, rtol=0)
    assert 100 < ((found > 0.01) & (found < 0.99)).sum()


def test_what_leaves_the_surface_of_a_lobe_is_that_of_the_reference():
    surface, view = random_units(COUNT, 6), random_units(COUNT, 7)
    normal = normalize(surface + 0.7 * random_units(COUNT, 8), dim=-1)
    squared = 0.01 + 0.2 * torch.rand(COUNT, 1, generator=torch.Generator().manual_seed(9))
    to_eye = -along(normal, view)
    above = along(surface, view) + 2 * to_eye * along(normal, surface)
    found = torch.tensor([occluded(*row) for row in zip(above, to_eye, squared[:, 0].numpy(), strict=True)])
    torch.testing.assert_close(found, horizon_occlusion(normal, surface, view, squared)[:, 0], atol=1e-4, rtol=1e-3)
    assert 100 < ((found > 0.01) & (found < 0.99)).sum()
