"""Features of light: linear, unchanged by a rotation of everything, alike in both backends, and physical."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.light.brdf import (
    INDEX,
    NAIL_ROUGHNESS,
    ROUGHNESS,
    bump_shadowing,
    clamped_reflection_normal,
    fresnel,
    ggx,
)
from livehand.backend.light.indirect_diffuse import MeshPoints, Surfels
from livehand.backend.light.lighting import (
    COEFFICIENTS,
    DIFFUSE,
    EVEN_LIGHT,
    GLOSS,
    SCATTERED,
    BumpMapping,
    FrameShadows,
    LightFeatures,
    SurfacePoints,
    SurfelIrradiance,
    ambient_occlusion,
    around_surface,
    diffuse_light,
    light_features,
    shaded_colour,
)
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds, PointShadows
from livehand.backend.light.sky_samples import SKY_DIRECTIONS, SkySamples
from livehand.backend.records.light import Lamp, Light, Sky, rotation_facing
from livehand.backend.render.measured_light import corrected
from torch.nn.functional import normalize

POINTS, PROBES = 50, 40
BOUNDS = Bounds(torch.zeros(3), torch.tensor(0.1))
GENERATOR = torch.Generator().manual_seed(3)
UNIT = 2.0**-24  # the most by which rounding to single precision changes a number of 1


def assert_within(ours, theirs, bound):
    """Compare by a bound of each number."""
    over = ((ours - theirs).abs() / bound.clamp(min=1e-12)).max()
    assert over <= 1, f"{float(over)} times what rounding explains"


def rand(*shape):
    return torch.rand(*shape, generator=GENERATOR)


def some_light():
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    lamps = (
        Lamp("area", np.array([3.0, 2, 1]), np.array([0.3, -0.4, 0.5]), rotation, size_m=(0.2, 0.3)),
        Lamp("spot", np.array([1.0, 2, 9]), np.array([-0.3, 0.4, 0.2]), rotation, radius_m=0.02, cone_rad=3.0),
        Lamp("sun", np.array([0.5, 0.7, 0.2]), rotation=rotation, casts_shadow=False),
    )
    return Light(lamps, Sky(np.random.default_rng(2).uniform(0, 1, (16, 32, 3))))


def some_points():
    normal = normalize(rand(POINTS, 3) - 0.5, dim=-1)
    relief = normalize(normal + 0.3 * (rand(POINTS, 3) - 0.5), dim=-1)
    view = normalize(rand(POINTS, 3) - 0.5 - 0.8 * normal, dim=-1)
    weight = rand(POINTS, 3)
    weight = weight / weight.sum(1, keepdim=True) * (rand(POINTS, 1) > 0.2)
    hit_points = MeshPoints(torch.randint(PROBES, (POINTS, 3), generator=GENERATOR), weight)
    return SurfacePoints(0.1 * (rand(POINTS, 3) - 0.5), normal, relief, view, hit_points)


def some_shadows(light):
    def of(count):
        return PointShadows(rand(count, POINTS), 0.02 * rand(count, POINTS))

    sky, lamps = of(len(light.sky.towards)), of(len(light.lamps.lamp))
    position, normal = 0.1 * (rand(PROBES, 3) - 0.5), normalize(rand(PROBES, 3) - 0.5, dim=-1)
    skin = Surfels(position, normal, torch.arange(PROBES), 4e-4 * rand(PROBES))
    of_sky, of_lamps = rand(len(light.sky.towards), PROBES), rand(len(light.lamps.rgb), PROBES)
    return FrameShadows(sky, lamps, SurfelIrradiance(skin, rand(PROBES, 3), of_sky, of_lamps))


def beside(count):
    """Places beside any mesh."""
    return MeshPoints(torch.zeros(count, 3, dtype=torch.long), torch.zeros(count, 3))


def no_probes(lamps, directions=SKY_DIRECTIONS):
    """Skin that light does not reach."""
    up = torch.tensor([0.0, 0, 1]).expand(PROBES, 3)
    skin = Surfels(torch.zeros(PROBES, 3), up, torch.arange(PROBES), torch.full((PROBES,), 1e-4))
    return SurfelIrradiance(skin, torch.ones(3), torch.zeros(directions, PROBES), torch.zeros(lamps, PROBES))


def some_coefficients():
    return rand(POINTS, COEFFICIENTS)


@pytest.fixture
def lit():
    light = LightSamples.of(some_light(), BOUNDS)
    return light, some_shadows(light), some_points()


def scaled(light, sky, *lamps):
    return LightSamples(
        SkySamples.mixed((light.sky,), torch.full((1, 3), sky)),
        light.lamps._replace(rgb=torch.tensor(lamps)[:, None] * light.lamps.rgb),
    )


def test_both_backends_agree(backend_pair, lit):
    ours, theirs = (backend.light_features(*lit) for backend in backend_pair)
    for name in LightFeatures._fields:
        torch.testing.assert_close(getattr(ours, name), getattr(theirs, name), atol=1e-5, rtol=1e-4)


def test_light_adds_up(lit, backend):
    """The colour in all light is the sum of those in its parts, to single precision."""
    light, shadows, points = lit
    coefficients = some_coefficients()

    def colour(*factors):
        features = backend.light_features(scaled(light, *factors), shadows, points)
        return shaded_colour(coefficients, points.relief_normal, points.view, features)

    whole = colour(1.0, 1.0, 1.0, 1.0)
    parts = [colour(*row) for row in torch.eye(4).tolist()]
    assert float((sum(parts) - whole).abs().max() / whole.mean()) < 1e-5
    torch.testing.assert_close(colour(1e4, 1e4, 1e4, 1e4), 1e4 * whole, rtol=1e-4, atol=1e-3)
    torch.testing.assert_close(colour(1e-4, 1e-4, 1e-4, 1e-4), 1e-4 * whole, rtol=1e-4, atol=1e-10)
    assert (whole >= 0).all()


def test_a_white_diffuse_surface_reflects_irradiance_over_pi():
    light = LightSamples.of(Light((Lamp("sun", np.array([pi, 2 * pi, 0])),)), BOUNDS)
    lit_fully = PointShadows(torch.ones(1, 3), torch.zeros(1, 3))
    sky = PointShadows(torch.ones(64, 3), torch.zeros(64, 3))
    normal = torch.tensor([[0.0, 0, 1], [0, 0.6, 0.8], [0, 0, -1]])
    points = SurfacePoints(torch.zeros(3, 3), normal, normal, -normal, beside(3))
    shadows = FrameShadows(sky, lit_fully, no_probes(1))
    coefficients = torch.zeros(3, COEFFICIENTS)
    coefficients[:, DIFFUSE] = 1
    found = shaded_colour(coefficients, normal, -normal, light_features(light, shadows, points))
    torch.testing.assert_close(found, torch.tensor([[1.0, 2, 0], [0.8, 1.6, 0], [0, 0, 0]]), atol=1e-5, rtol=1e-5)


def test_shadow_takes_the_lamps_light_away_unless_it_casts_none(lit):
    light, shadows, points = lit
    dark = shadows._replace(lamps=PointShadows(torch.zeros_like(shadows.lamps.lit), shadows.lamps.depth_in_m))
    vectors = light_features(light, dark, points).lamp_vectors
    assert vectors[:, :2].abs().max() == 0
    assert vectors[:, 2].abs().max() > 0


def test_even_light_arrives_inside_the_skin_as_much_however_far_it_reaches_around():
    """The mean over the sphere, which is a fourth of the integral over pi; the cosines of even light are even."""
    cosines = (torch.arange(200_000, dtype=torch.float64) + 0.5) / 100_000 - 1
    assert (4 * around_surface(cosines).mean(0)).tolist() == pytest.approx(EVEN_LIGHT, rel=1e-6)


def test_light_inside_the_skin_decays_with_depth_and_the_deep_one_reaches_round_the_edge():
    light = LightSamples.of(Light((Lamp("sun", np.ones(3)),)), BOUNDS)
    depth = torch.tensor([[0.0, 0.002, 0.01, 0.0, 0.0]])
    normal = torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 0, -1]])
    points = SurfacePoints(torch.zeros(5, 3), normal, normal, -normal, beside(5))
    sky = PointShadows(torch.zeros(64, 5), torch.zeros(64, 5))
    shadows = FrameShadows(sky, PointShadows(torch.zeros(1, 5), depth), no_probes(1))
    long, short = light_features(light, shadows, points).scattered[..., 0].T * pi
    assert short[0] == pytest.approx(1.25)
    assert long[0] == pytest.approx(1)
    assert short[1] == pytest.approx(1.25 * np.exp(-0.002 / 0.0012), rel=1e-4)
    assert long[1] == pytest.approx(np.exp(-0.5), rel=1e-4)
    assert long[2] > 10 * short[2]
    assert short[3] == short[4] == 0
    assert long[3] == pytest.approx(0.7 / 1.7)
    assert long[4] == 0


def test_what_a_lobe_reflects_is_less_than_what_arrives():
    """White furnace: light from everywhere is reflected by each lobe in no more than Fresnel's share."""
    side = 400
    z = (torch.arange(side) + 0.5) / side
    angle = 2 * pi * torch.arange(side) / side
    radius = (1 - z * z).sqrt()
    towards = torch.stack(
        [radius[:, None] * angle.cos(), radius[:, None] * angle.sin(), z[:, None].expand(-1, side)], -1
    ).reshape(-1, 3)
    normal = torch.tensor([0.0, 0, 1]).expand_as(towards)
    for degrees in (0, 40, 70):
        view = -torch.tensor([np.sin(np.deg2rad(degrees)), 0, np.cos(np.deg2rad(degrees))]).float()
        lobes = ggx(normal, towards, view.expand_as(towards), torch.zeros(len(towards)))
        # `ggx` is pi times the reflectance function times the cosine; the hemisphere's solid angle is 2 pi.
        albedo = lobes.mean(0) * 2
        assert (albedo > 0.015).all()
        assert (albedo < 0.35).all()
        if degrees == 0:
            assert albedo[0] == pytest.approx(0.028, rel=0.1)
            on_nails = ggx(normal, towards, view.expand_as(towards), torch.zeros(len(towards)), torch.tensor(1.0))
            assert on_nails[:, 0].mean() * 2 == pytest.approx(0.028, rel=0.1)


def test_fresnel_is_that_of_both_polarisations():
    """Snell's and Fresnel's laws, one by one; none is left at grazing light."""
    angle = torch.linspace(0, 1.57, 60, dtype=torch.float64)
    inside = torch.asin(angle.sin() / INDEX)
    across = (torch.sin(angle - inside) / torch.sin(angle + inside)) ** 2
    along = (torch.tan(angle - inside) / torch.tan(angle + inside)) ** 2
    torch.testing.assert_close(fresnel(angle.cos())[1:], ((across + along) / 2)[1:], rtol=1e-6, atol=0)
    assert float(fresnel(torch.tensor(1.0))) == pytest.approx((0.4 / 2.4) ** 2, rel=1e-5)
    assert float(fresnel(torch.tensor(0.0))) == pytest.approx(1.0)


def test_a_mirror_like_lobe_is_brightest_in_the_mirror_direction():
    normal = torch.tensor([0.0, 0, 1])
    view = -normalize(torch.tensor([0.5, 0, 1.0]), dim=0)
    angles = torch.linspace(-1.2, 1.2, 241)
    towards = torch.stack([-angles.sin(), torch.zeros(241), angles.cos()], -1)
    lobes = ggx(normal.expand(241, 3), towards, view.expand(241, 3), torch.zeros(241))
    assert float(angles[lobes[:, 0].argmax()]) == pytest.approx(np.arctan(0.5), abs=0.05)
    assert lobes[:, 0].max() > lobes[:, 1].max()
    wide = ggx(normal.expand(241, 3), towards, view.expand(241, 3), torch.full((241,), 0.5))
    assert wide[:, 0].max() < lobes[:, 0].max()


@pytest.mark.parametrize("radius_rad", [0.05, 0.15, 0.4])
def test_a_lights_size_widens_a_lobe_as_the_mean_over_its_disc_does(radius_rad):
    up = torch.tensor([[0.0, 0, 1]])
    count = 20000
    z = 1 - (torch.arange(count) + 0.5) / count * (1 - np.cos(radius_rad))
    angle = torch.arange(count) * pi * (3 - 5**0.5)
    across = (1 - z * z).sqrt()
    towards = torch.stack([across * angle.cos(), across * angle.sin(), z], -1)
    mean = ggx(up, towards, -up, torch.zeros(count)).mean(0)
    torch.testing.assert_close(ggx(up, up, -up, torch.full((1,), radius_rad))[0], mean, rtol=0.06, atol=0)


def test_nails_shine_in_a_narrower_and_brighter_lobe():
    """In the mirror direction a lobe is as bright as 1 / alpha^2, and alpha is the square of the roughness."""
    up = torch.tensor([[0.0, 0, 1]])
    skin, half, nail = (ggx(up, up, -up, torch.zeros(1), torch.tensor([share])) for share in (0.0, 0.5, 1.0))
    alphas = [ROUGHNESS[0] ** 2, NAIL_ROUGHNESS**2]
    assert float(nail[0, 0] / skin[0, 0]) == pytest.approx((alphas[0] / alphas[1]) ** 2, rel=1e-3)
    assert float(half[0, 0] / skin[0, 0]) == pytest.approx((alphas[0] / np.mean(alphas)) ** 2, rel=1e-3)
    assert skin[0, 1] == nail[0, 1]
    torch.testing.assert_close(skin, ggx(up, up, -up, torch.zeros(1)))


def test_the_gloss_of_skin_is_as_wide_as_it_is_known():
    up = torch.tensor([[0.0, 0, 1]])
    found = ggx(up, up, -up, torch.zeros(1), None, torch.tensor([0.05]))
    plain = ggx(up, up, -up, torch.zeros(1))
    assert float(found[0, 1] / plain[0, 1]) == pytest.approx(ROUGHNESS[1] ** 4 / 0.05, rel=1e-3)
    assert found[0, 0] == plain[0, 0]


def under_a_lamp(towards, normal, view, coefficients, scattered=(0.0, 0.0), **known):
    """The colour of one point of skin whose surface faces up, in the light of a white sun."""
    up = torch.tensor([[0.0, 0, 1]])
    features = LightFeatures(
        lamp_vectors=towards[:, None],
        lamp_rgb=torch.ones(1, 3),
        lamp_radius_rad=torch.zeros(1),
        sky_vectors=torch.zeros(1, 3, 3),
        lobe_visibility=torch.zeros(1, 2),
        mirrored=PrefilteredEnvironment.of(None, "cpu"),
        near_field_specular=torch.zeros(1, 2, 3),
        scattered=torch.tensor(scattered)[None, :, None].expand(1, 2, 3),
        arriving=torch.ones(1, 3),
        reflected=torch.zeros(1, 3),
    )
    return shaded_colour(coefficients, normal, view, features, BumpMapping.smooth(up)._replace(**known))[0]


def coefficients_of(part):
    coefficients = torch.zeros(1, COEFFICIENTS)
    coefficients[:, part] = 1
    return coefficients


def test_colours_that_are_scattered_far_show_less_relief():
    """Red the blurred normal alone, blue the sharp one, green both."""
    up, bent = torch.tensor([[0.0, 0, 1]]), torch.tensor([[0.28, 0, 0.96]])
    towards = torch.tensor([[0.6, 0, 0.8]])
    known = {"blurred_normal": up, "sharpness": torch.tensor([0.0, 0.5, 1])}
    red, green, blue = under_a_lamp(towards, bent, -up, coefficients_of(DIFFUSE), **known)
    under = float(blue / (0.6 * 0.28 + 0.8 * 0.96) / bump_shadowing(bent, up, towards))
    assert float(red) == pytest.approx(0.8 * under)
    assert float(green) == pytest.approx((red + blue) / 2)
    assert under == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize(("bend", "scattered"), [(0.28, 1.0), (-0.28, 1.0), (-0.28, 0.1)])
def test_light_that_enters_a_little_deeper_shows_the_relief_and_the_deepest_does_not(bend, scattered):
    """As much of it as of light that does not enter at all; never less than none."""
    up, bent = torch.tensor([[0.0, 0, 1]]), torch.tensor([[bend, 0, 0.96]])
    towards = torch.tensor([[0.6, 0, 0.8]])
    deep, shallow = slice(SCATTERED.start, SCATTERED.start + 3), slice(SCATTERED.start + 3, SCATTERED.stop)
    lit = under_a_lamp(towards, bent, -up, coefficients_of(shallow), (0.0, scattered))
    plain = under_a_lamp(towards, bent, -up, coefficients_of(deep), (1.0, 0.0))
    direct = under_a_lamp(towards, bent, -up, coefficients_of(DIFFUSE)) / plain
    expected = (scattered + EVEN_LIGHT[1] * (direct - 0.8)).clamp(min=0) * plain
    torch.testing.assert_close(lit, expected)
    assert (direct - 0.8).abs().min() > 0.03
    torch.testing.assert_close(plain, torch.ones(3), atol=0.01, rtol=0)


def test_light_that_gloss_reflects_does_not_enter_the_skin():
    """A bump that is seen from the side sheds less than the surface, by what both mirror of even light."""
    up, bent = torch.tensor([[0.0, 0, 1]]), torch.tensor([[-0.6, 0, 0.8]])
    view = -normalize(torch.tensor([[0.8, 0, 0.6]]), dim=-1)
    mirroring = clamped_reflection_normal(bent, up, view)
    both = torch.cat([mirroring, up])
    skin = BumpMapping.smooth(both).alphas_squared
    even = PrefilteredEnvironment.of(None, "cpu").of_even_light(both, view.expand(2, 3), skin)[:, 1]
    blurred_light = under_a_lamp(up, bent, view, coefficients_of(DIFFUSE), sharpness=torch.zeros(3))
    torch.testing.assert_close(blurred_light, ((1 - even[0]) / (1 - even[1])).expand(3))
    assert even[0] > even[1] + 0.02


def test_gloss_takes_the_colour_of_the_light(lit):
    light, shadows, points = lit
    coefficients = torch.zeros(POINTS, COEFFICIENTS)
    coefficients[:, GLOSS] = 1
    blue = scaled(light, 0.0, 0.0, 1.0, 0.0)
    features = light_features(blue, shadows, points)._replace(reflected=torch.zeros(POINTS, 3))
    colour = shaded_colour(coefficients, points.relief_normal, points.view, features)
    bright = colour[colour[:, 2] > 1e-4]
    torch.testing.assert_close(bright / bright[:, 2:], torch.tensor([1 / 9, 2 / 9, 1]).expand_as(bright))


def test_the_sky_is_seen_as_far_as_nothing_hides_what_a_lobe_mirrors(lit, backend):
    light, shadows, points = lit
    across = normalize(torch.linalg.cross(points.relief_normal, torch.tensor([1.0, 0, 0]).expand(POINTS, 3)), dim=-1)
    to_eye = torch.tensor([0.9, 0.4]).repeat(POINTS // 2)[:, None]
    points = points._replace(view=-(to_eye * points.relief_normal + (1 - to_eye**2).sqrt() * across))

    def seen(visible, sky=light.sky):
        hidden = shadows._replace(sky=PointShadows(visible.contiguous(), shadows.sky.depth_in_m))
        return backend.light_features(light._replace(sky=sky), hidden, points).lobe_visibility

    whole = torch.ones(64, POINTS)
    torch.testing.assert_close(seen(whole), torch.ones(POINTS, 2))
    torch.testing.assert_close(seen(0.25 * whole), torch.full((POINTS, 2), 0.25))
    mirrored = points.view - 2 * (points.view * points.relief_normal).sum(-1, keepdim=True) * points.relief_normal
    at_mirror = (light.sky.towards @ mirrored.T > np.cos(0.7)).float()
    assert (seen(at_mirror) > seen(1 - at_mirror)).float().mean() > 0.9
    black = light.sky._replace(flux=torch.zeros_like(light.sky.flux))
    assert seen(whole, black).abs().max() == 0


def test_openness_is_one_in_the_open_and_points_along_the_normal():
    light = LightSamples.of(Light(), BOUNDS)
    normal = normalize(rand(POINTS, 3) - 0.5, dim=-1)
    clear = PointShadows(torch.ones(64, POINTS), torch.zeros(64, POINTS))
    found = ambient_occlusion(light.sky, clear, normal)
    torch.testing.assert_close(found.share, torch.ones(POINTS), atol=0.05, rtol=0)
    assert ((found.towards * normal).sum(-1) > 0.98).all()
    half = PointShadows((light.sky.towards[:, :1] > 0).float().expand(-1, POINTS), clear.depth_in_m)
    up = torch.tensor([[0.0, 0, 1]]).expand(POINTS, 3)
    assert ambient_occlusion(light.sky, half, up).share[0] == pytest.approx(0.5, abs=0.05)


def test_measured_light_replaces_what_is_computed(lit, backend):
    """What is measured as computed changes nothing but what is reflected; half of it halves; none is dark."""
    light, shadows, points = lit
    coefficients, none = some_coefficients(), torch.zeros(POINTS, 3)
    features = backend.light_features(light, shadows, points)._replace(reflected=none)

    def colour(direct, indirect=none):
        given = corrected(features, points.normal, direct, indirect)
        return shaded_colour(coefficients, points.relief_normal, points.view, given)

    ours = diffuse_light(features, points.normal)
    plain = shaded_colour(coefficients, points.relief_normal, points.view, features)
    torch.testing.assert_close(colour(ours), plain, rtol=1e-4, atol=1e-5)
    bright = ours > ours.mean()
    torch.testing.assert_close(colour(0.5 * ours)[bright], 0.5 * plain[bright], rtol=0.03, atol=1e-3)
    assert colour(none)[bright].max() < 0.05 * plain.max()


def test_light_that_only_the_measurement_knows_is_reflected_as_if_it_came_from_everywhere(lit):
    """By gloss, too, of whatever sky: so is what the hand sheds on itself."""
    light, shadows, points = lit
    dark = scaled(light, 0.0, 0.0, 0.0, 0.0)
    features = light_features(dark, shadows, points)
    coefficients = some_coefficients()
    lamp = torch.rand(POINTS, 3, generator=GENERATOR)
    given = corrected(features, points.normal, lamp, 2 * lamp)
    found = shaded_colour(coefficients, points.relief_normal, points.view, given)
    white = coefficients[:, DIFFUSE] + coefficients[:, SCATTERED].reshape(-1, 2, 3).sum(1)
    skin = BumpMapping.smooth(points.relief_normal).alphas_squared
    even = PrefilteredEnvironment.of(None, "cpu").of_even_light(points.relief_normal, points.view, skin)
    glossy_share = (coefficients[:, GLOSS] * even).sum(1, keepdim=True)
    assert (glossy_share > 0.01 * white).any()
    torch.testing.assert_close(found, 3 * lamp * (white + glossy_share), rtol=1e-4, atol=1e-5)


def test_openness_is_the_references_where_no_sky_is_seen_too(backend_pair):
    random = torch.Generator().manual_seed(7)
    sky, normal = SkySamples.of(None, "cpu"), normalize(torch.randn(200, 3, generator=random), dim=-1)
    lit = torch.rand(len(sky.towards), 200, generator=random) * (torch.rand(200, generator=random) < 0.9)
    shadows = PointShadows(lit, torch.zeros_like(lit))
    ours, theirs = (each.ambient_occlusion(sky, shadows, normal) for each in backend_pair)
    torch.testing.assert_close(ours.share, theirs.share)
    torch.testing.assert_close(ours.towards, theirs.towards, atol=1e-5, rtol=0)
    assert (ours.share == 0).any()
    assert ours.share.max() > 0.4


def test_lamps_of_every_kind_shine_as_in_the_reference_on_more_points_than_one_block(backend_pair):
    random, turn = torch.Generator().manual_seed(8), np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    near, rgb = np.array([0.1, -0.12, 0.15]), np.array([3.0, 2, 1])
    lamps = (
        Lamp("point", rgb, near),
        Lamp("area", rgb, near, rotation_facing(near / np.linalg.norm(near)), size_m=(0.05, 0.05), spread_rad=1.2),
        Lamp("area", rgb, near, turn, size_m=(0.05, 0.05)),
        Lamp("spot", rgb, near, rotation_facing(near / np.linalg.norm(near)), cone_rad=0.6),
        Lamp("sun", rgb, rotation=turn, casts_shadow=False),
    )
    light = LightSamples.of(Light(lamps), Bounds(torch.zeros(3), torch.tensor(0.1)))
    count, samples = 150, len(light.lamps.lamp)
    vectors = (normalize(torch.randn(count, 3, generator=random), dim=-1) for _ in range(3))
    points = SurfacePoints(0.1 * torch.rand(count, 3, generator=random) - 0.05, *vectors, beside(count))
    sky, of_lamps = (
        PointShadows(torch.rand(k, count, generator=random), 0.02 * torch.rand(k, count, generator=random))
        for k in (len(light.sky.towards), samples)
    )
    skin = Surfels(
        torch.zeros(1, 3), torch.tensor([[0.0, 0, 1]]), torch.zeros(1, dtype=torch.long), torch.tensor([1e-4])
    )
    dark = SurfelIrradiance(skin, torch.ones(3), torch.zeros(len(light.sky.towards), 1), torch.zeros(5, 1))
    shadows = FrameShadows(sky, of_lamps, dark)
    ours, theirs = (each.light_features(light, shadows, points) for each in backend_pair)
    # Edges of cones and beams are steep: the cosine to a lamp's axis, of 8 roundings, is multiplied by up to 224 (1.5
    # `cone_edge`), and its difference from 1 by more. All else, of 32 roundings, is products and sums of one sign.
    vectors, scattered = off_by_rounding(light, shadows, points, 8)
    assert_within(ours.lamp_vectors, theirs.lamp_vectors, vectors + 32 * UNIT * theirs.lamp_vectors.abs())
    # Sums of 64 + 21 terms of one sign and as many roundings in each as above. The kernel's exp(-x), four terms of the
    # series of x / 16 to the power of 16, is off by 2.7e-6 at most, times what would arrive at no depth.
    flat = light_features(light, FrameShadows(at_no_depth(sky), at_no_depth(of_lamps), dark), points).scattered
    assert_within(ours.scattered, theirs.scattered, scattered + 128 * UNIT * theirs.scattered + 2.7e-6 * flat)
    assert ((theirs.lamp_vectors.norm(dim=-1) > 0).float().mean(0) > 0.1).all()


def at_no_depth(shadows):
    return shadows._replace(depth_in_m=torch.zeros_like(shadows.depth_in_m))


def in_double(values):
    """A tensor, or a tuple of tuples of tensors, in double precision where it has floating point."""
    if isinstance(values, tuple):
        return values._make(map(in_double, values))
    return values.double() if isinstance(values, torch.Tensor) and values.is_floating_point() else values


def off_by_rounding(light, shadows, points, roundings):
    """What lamps and scattering change where cosines to lamps' axes are off by so many roundings, up and down."""
    light, shadows, points = in_double(light), in_double(shadows), in_double(points)
    plain = light_features(light, shadows, points)
    vectors, scattered = torch.zeros_like(plain.lamp_vectors), torch.zeros_like(plain.scattered)
    for factor in (1 - roundings * UNIT, 1 + roundings * UNIT):
        lamps = light.lamps._replace(axis=factor * light.lamps.axis)
        turned = light_features(light._replace(lamps=lamps), shadows, points)
        vectors += (turned.lamp_vectors - plain.lamp_vectors).abs()
        scattered += (turned.scattered - plain.scattered).abs()
    return vectors, scattered
