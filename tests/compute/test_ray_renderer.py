"""Rays of the fused renderer against the field queried along traced rays (`field.shade.shade`)."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import build_field
from livehand.backend.compute.cpu.field import FusedRayRenderer
from livehand.backend.compute.cpu.rays import trace
from livehand.backend.compute.kernels import field as kernels
from livehand.backend.compute.kernels.vectors import has_half_precision
from livehand.backend.field.field import BakedField, FieldConfig
from livehand.backend.field.rays import CameraTensors, HandInView
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.shade import shade
from livehand.backend.field.volume import Composite
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.records.render_hooks import RenderHooks

pytestmark = pytest.mark.slow

CONFIG = SamplerConfig(8, 0.003)
# Channels that fill blocks of four, and others that do not; one plane without height.
FIELDS = {
    "default": FieldConfig(),
    "odd": FieldConfig(width=24, density_width=12, planes=((32, 3, 4), (64, 2, 8), (128, 1, 4)), relief=48),
}
# A fused ray stops when its transmittance is below this.
STOP = float(kernels._TRANSPARENT)
# Share of rays that rounding may lead elsewhere (test_rays.py says why); none of 20,000 was.
FLIPPED = 5e-4


def a_field(name):
    """Untrained, but with weights that tell: planes, relief and density vary over the hand."""
    torch.manual_seed(3)
    field = build_field(FIELDS[name])
    with torch.no_grad():
        for plane in (*field.planes, field.relief):
            plane.table.uniform_(-1, 1).copy_(plane.table.half())  # as in files
        field.density.weight.mul_(3)
    return field.eval()


@pytest.fixture(scope="module", params=FIELDS)
def field(request):
    return a_field(request.param)


def test_a_relightable_fields_rays_are_gathered_and_not_decoded(posed, view_from):
    """Its gathered features end with the normals: it has no light code."""
    field, hand = build_field(replace(FIELDS["odd"], light="linear")), posed("open")
    in_view = HandInView(hand.mesh, hand.topology, view_from(hand.mesh, (0.3, 1, 0.2)))
    conditions = hand.conditions()._replace(visibility=torch.zeros(len(hand.mesh.vertices), 0))
    with torch.inference_mode():
        rays = FusedRayRenderer(field, CONFIG)(in_view, conditions, RenderHooks())
        expected = shade(field, trace(in_view, CONFIG), in_view, conditions, CONFIG.shell_m)
    assert rays.composite.channels.shape == (len(rays.pixel), field.gathered_channels)
    largest = expected.channels.abs().amax(0).clamp(min=1)
    assert share_over((rays.composite.channels - expected.channels) / largest, 2 * STOP) < 0.01


class Fused:
    """One scene by both backends: what is composited along each ray, and what is decoded from that."""

    @torch.inference_mode()
    def __init__(self, field, hand, camera, config=CONFIG, conditions=None):
        conditions = conditions or hand.conditions()
        in_view = HandInView(hand.mesh, hand.topology, camera)
        renderer = FusedRayRenderer(field, config)
        self.pixel, self.view, self.gathered, self.t, self.dt = renderer.gather(in_view, conditions, RenderHooks())
        self.decoded = renderer.decode(self.gathered, self.view)
        # By the kernels: on a seam of the atlas either side's face is as near, and untrained planes differ there.
        rays = trace(in_view, config)
        surroundings = (rays, in_view, conditions, config.shell_m)
        self.expected_pixel, self.is_stopped, self.expected_steps = rays.pixel, rays.is_stopped, (rays.t, rays.dt)
        self.expected_decoded = shade(field, *surroundings)
        self.expected_gathered = shade(Undecoded(field), *surroundings)
        self.expected_view = rays.directions / rays.directions.norm(dim=-1, keepdim=True)


class Undecoded(BakedField):
    """The same field without its decoder."""

    def __init__(self, field):
        super().__init__(field.config)
        self.load_state_dict(field.state_dict())

    def shaded(self, gathered, view):
        return gathered


def share_over(difference, bound):
    """Share of rays [R] or [R, C] with anything beyond the bound."""
    over = difference.abs() > bound
    return (over.any(1) if over.ndim == 2 else over).double().mean() if len(over) else 0.0


def assert_same(rendered):
    """They differ by no more than the light that an early stop leaves out, and by rounding."""
    assert torch.equal(rendered.pixel, rendered.expected_pixel)
    torch.testing.assert_close(rendered.view, rendered.expected_view)
    ours, theirs = rendered.gathered, rendered.expected_gathered
    assert ours.channels.shape == theirs.channels.shape
    if len(rendered.pixel) == 0:
        return
    few = FLIPPED + 1.5 / len(rendered.pixel)  # one ray is always allowed
    largest = theirs.channels.abs().amax(0).clamp(min=1)
    # Twice: the light left out and, for a ray that ends opaque, its compensation.
    assert share_over(ours.alpha - theirs.alpha, STOP + 1e-5) < few
    assert share_over((ours.channels - theirs.channels) / largest, 2 * STOP) < few
    assert share_over((ours.depth - theirs.depth)[theirs.alpha > 0.5], 4e-4) < few
    is_clear = theirs.alpha < 1 - 1.01 * STOP  # not stopped early
    assert share_over(ours.weights - theirs.weights, 2 * STOP) < few
    assert share_over(ours.weights.sum(1) - ours.alpha, 1e-5) < few
    queried = (ours.weights > 0).float()
    assert share_over((rendered.t - rendered.expected_steps[0]) * queried, 1e-6) < few
    torch.testing.assert_close(rendered.dt, rendered.expected_steps[1])
    for one, other in ((ours.alpha, theirs.alpha), (ours.channels, theirs.channels)):
        assert share_over((one - other)[is_clear], 1e-4) < few
    difference = rendered.decoded.channels - rendered.expected_decoded.channels
    assert share_over(difference[:, :3], STOP) < few
    assert share_over(difference[is_clear], 1e-4) < few
    assert difference[:, :3].abs().mean() < STOP / 10
    assert share_over(difference, 4 * STOP) < few  # features have no bounds of their own
    assert torch.equal(rendered.decoded.alpha, ours.alpha)
    assert torch.equal(rendered.decoded.depth, ours.depth)


@pytest.mark.parametrize("direction", [(0.1, -1, 0.2), (0.2, 0.3, -1), (-1, -0.5, 0.3)])
@pytest.mark.parametrize(("gesture", "side"), [("open", "right"), ("fist", "right"), ("pinch", "left")])
def test_fused_rays_are_the_fields(field, posed, view_from, direction, gesture, side):
    hand = posed(gesture, side)
    rendered = Fused(field, hand, view_from(hand.mesh, direction))
    assert len(rendered.pixel) > 200
    assert_same(rendered)
    alpha = rendered.expected_decoded.alpha
    assert int(((alpha > 0.05) & (alpha < 0.95)).sum()) > 20
    assert rendered.is_stopped.any()
    assert not rendered.is_stopped.all()


def test_planes_of_channels_that_fill_no_whole_block(posed, view_from, monkeypatch):
    monkeypatch.setitem(FIELDS, "narrow", FieldConfig(width=24, planes=((32, 3, 6), (64, 1, 5)), relief=48))
    hand = posed("open")
    assert_same(Fused(a_field("narrow"), hand, view_from(hand.mesh, (0.1, -1, 0.2))))


@pytest.fixture(scope="module")
def odd():
    return a_field("odd")


@pytest.fixture(scope="module")
def scene(posed, view_from):
    hand = posed("relaxed")
    return hand, view_from(hand.mesh, (0.1, 1, 0.3))


def test_stopped_rays_are_opaque(odd, scene):
    rendered = Fused(odd, *scene)
    assert rendered.gathered.alpha[rendered.is_stopped].min() >= 1 - STOP
    assert rendered.gathered.alpha.max() <= 1
    assert rendered.gathered.alpha.min() >= 0


@torch.inference_mode()
def test_what_is_the_same_everywhere_comes_out_as_that_times_alpha(posed, view_from):
    """Also of rays that are opaque in the end and stopped before: from near, where planes do not fade."""
    field, hand = a_field("odd"), posed("fist")
    for plane in field.planes:
        plane.table.fill_(0.75)
    field.density.bias.add_(3)  # solid: rays stop well before their last sample
    view = view_from(hand.mesh, (0.1, 1, 0.1), (40, 40), distance=0.3, field_m=0.04)
    in_view = HandInView(hand.mesh, hand.topology, view)
    gathered = FusedRayRenderer(field, CONFIG).gather(in_view, hand.conditions(), RenderHooks()).gathered
    constant = gathered.channels[:, : sum(channels for _, _, channels in field.config.planes)]
    torch.testing.assert_close(constant, 0.75 * gathered.alpha[:, None].expand_as(constant), atol=1e-5, rtol=0)
    assert (gathered.alpha == 1).any()


@pytest.mark.parametrize(("samples", "shell_m", "layers"), [(1, 0.003, 10), (3, 0.005, 10), (16, 0.002, 2)])
def test_other_samplers(odd, scene, samples, shell_m, layers):
    assert_same(Fused(odd, *scene, SamplerConfig(samples, shell_m, layers)))


def test_an_orthographic_cameras_fused_rays_are_the_fields(odd, scene):
    """Its pixels are as wide at every depth, by which planes fade."""
    hand, view = scene
    K, depth = view.K.clone(), hand.mesh.vertices.mean(0) @ view.world2cam[2, :3] + view.world2cam[2, 3]
    K[:2, :2] /= depth
    assert abs(depth - 1) > 0.2  # where both widths are the same
    rendered = Fused(odd, hand, CameraTensors(K, view.world2cam, view.size_px, is_orthographic=True))
    assert len(rendered.pixel) > 200
    assert_same(rendered)


def test_nothing_in_view(odd, scene):
    hand, view = scene
    turned = torch.diag(torch.tensor([1.0, -1, -1, 1])) @ view.world2cam
    rendered = Fused(odd, hand, view._replace(world2cam=turned))
    assert_same(rendered)
    assert len(rendered.pixel) == 0


@pytest.mark.parametrize("size_px", [(1, 1), (40, 1)])
def test_one_pixel_and_one_row(odd, scene, size_px):
    hand, view = scene
    K = view.K.clone()
    K[:2, 2] += torch.tensor(size_px) / 2 - torch.tensor(view.size_px) / 2
    rendered = Fused(odd, hand, CameraTensors(K, view.world2cam, size_px))
    assert len(rendered.pixel) > 0
    assert_same(rendered)


def test_near_and_far_where_planes_fade(odd, posed, view_from):
    """From so far that a pixel spans many texels, and from so near that none does."""
    hand = posed("open")
    for size_px, field_m in (((12, 12), 0.25), ((40, 40), 0.04)):
        assert_same(Fused(odd, hand, view_from(hand.mesh, (0.1, 1, 0.1), size_px, field_m=field_m)))


def test_a_larger_world_looks_the_same(odd, scene):
    hand, view = scene
    large = hand._replace(mesh=posed_mesh(hand.topology, hand.mesh.vertices * 10))
    world2cam = view.world2cam.clone()
    world2cam[:3, 3] *= 10
    rendered = Fused(odd, large, view._replace(world2cam=world2cam))
    alike = Fused(odd, hand, view)
    shared = torch.isin(rendered.pixel, alike.pixel), torch.isin(alike.pixel, rendered.pixel)
    difference = rendered.decoded.channels[shared[0], :3] - alike.decoded.channels[shared[1], :3]
    assert share_over(difference, 2 * STOP) < 0.01
    assert share_over(rendered.decoded.alpha[shared[0]] - alike.decoded.alpha[shared[1]], 2 * STOP) < 0.01


@torch.inference_mode()
def test_threads_and_chunks_do_not_matter(odd, scene):
    hand, view = scene
    in_view = HandInView(hand.mesh, hand.topology, view)
    before, conditions, results, calls = torch.get_num_threads(), hand.conditions(), [], []
    hooks = RenderHooks(before_chunk=lambda: calls.append(None))
    try:
        for threads, size in ((1, 1 << 15), (2, 1 << 15), (2, 100), (1, 7)):
            torch.set_num_threads(threads)
            calls.clear()
            rays = FusedRayRenderer(odd, CONFIG, rays_per_chunk=size).gather(in_view, conditions, hooks)
            assert len(calls) == -(-len(rays.pixel) // size)
            results.append(rays.gathered)
    finally:
        torch.set_num_threads(before)
    for other in results[1:]:
        for one, values in zip(results[0], other, strict=True):
            assert torch.equal(one, values)


def test_what_is_raised_between_chunks_ends_the_render(odd, scene):
    hand, view = scene
    in_view, calls = HandInView(hand.mesh, hand.topology, view), []

    def before_chunk():
        calls.append(None)
        if len(calls) == 3:
            raise KeyError("stop")

    renderer, hooks = FusedRayRenderer(odd, CONFIG, rays_per_chunk=50), RenderHooks(before_chunk=before_chunk)
    with torch.inference_mode(), pytest.raises(KeyError, match="stop"):
        renderer(in_view, hand.conditions(), hooks)
    assert len(calls) == 3


@torch.inference_mode()
def test_decoding_in_chunks_is_decoding_at_once(odd):
    generator = torch.Generator().manual_seed(0)
    alpha = torch.rand(30, generator=generator)
    channels = torch.randn(30, odd.gathered_channels, generator=generator) * alpha[:, None]
    gathered = Composite(channels, alpha, alpha + 0.3, alpha[:, None])
    view = torch.nn.functional.normalize(torch.randn(30, 3, generator=generator), dim=-1)
    in_chunks = FusedRayRenderer(odd, CONFIG, rays_per_decode=7).decode(gathered, view)
    for one, other in zip(in_chunks, odd.shaded(gathered, view), strict=True):
        torch.testing.assert_close(one, other)


def test_a_field_is_packed_once(odd):
    renderer = FusedRayRenderer(odd, CONFIG)
    assert renderer._packed is renderer._packed
    assert renderer._packed.table.dtype == ("uint16" if has_half_precision() else "float32")


def test_values_beyond_half_precision_stay_single(odd):
    wide = a_field("odd")
    with torch.no_grad():
        wide.planes[1].table[0, 0] = 1e5
    assert FusedRayRenderer(wide, CONFIG)._packed.table.dtype == "float32"
