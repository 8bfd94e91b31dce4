"""The two fields: sizes as published, the density prior, what they depend on and what they do not."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import build_field
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.conditions import (
    LIGHT_CHANNELS,
    LOCAL_POSE_CHANNELS,
    FieldInputs,
    FrameConditions,
    gather_field_inputs,
    vertex_local_pose,
    view_features,
)
from livehand.backend.field.encoding import FeaturePlane
from livehand.backend.field.field import CHANNELS, FieldConfig
from livehand.backend.field.volume import Steps
from livehand.backend.geometry.local_rotation import local_rotations
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.torch_rotation import axis_angle_to_matrix
from livehand.backend.geometry.uvh import SurfaceSamples
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.topology import Skinning, topology_of
from livehand.backend.image.superres import PaperSuperRes, SuperResConfig
from torch.nn.functional import normalize

PAPER, PLANES = FieldConfig(kind="paper"), FieldConfig(planes=((64, 6, 8), (128, 3, 8), (256, 1, 4)), relief=64)


STEP_MM = 0.1


def inputs_of(rays, samples=1, seed=0, light=LIGHT_CHANNELS, **changes):
    """Random inputs of so many rays and samples of each."""
    count = rays * samples
    generator = torch.Generator().manual_seed(seed)

    def rand(*shape):
        return torch.rand(*shape, generator=generator)

    inputs = FieldInputs(
        uv=rand(count, 2),
        height=rand(count) * 2 - 1,
        normal=normalize(rand(count, 3) - 0.5, dim=-1),
        rotation=axis_angle_to_matrix(rand(count, 3)),
        local_pose=rand(count, LOCAL_POSE_CHANNELS) - 0.5,
        light=rand(count, light),
        view=normalize(rand(rays, 3) - 0.5, dim=-1),
        theta=rand(48) - 0.5,
        footprint_m=torch.full((count,), 5e-4),
    )
    return inputs._replace(**changes)


def ask(field, inputs):
    """What is seen along rays of equal steps."""
    rays = len(inputs.view)
    t = torch.linspace(0.4, 0.41, len(inputs.height) // rays if rays else 1).expand(rays, -1)
    return field(inputs, Steps(t, torch.full((rays,), STEP_MM), torch.zeros(rays, dtype=torch.bool)))


def density_and_channels(field, inputs):
    """Density per mm and straight channels at samples that are rays of their own."""
    seen = ask(field, inputs)
    return -torch.log1p(-seen.alpha) / STEP_MM, seen.channels / seen.alpha[:, None]


def parameters(network):
    return sum(parameter.numel() for parameter in network.parameters())


@pytest.fixture(params=[PAPER, PLANES], ids=["paper", "planes"])
def field(request):
    torch.manual_seed(0)
    return build_field(request.param)


def test_the_papers_field_has_the_papers_size():
    assert parameters(build_field(PAPER)) == 92_577
    assert parameters(build_field(replace(PAPER, pose=False))) == 86_433


def test_the_papers_superresolution_has_the_papers_size_but_for_the_folded_modulation():
    """320,906 published; folding drops the affine maps of 6 modulated layers (45 + 1 inputs each) and 4 noise gains."""
    network = PaperSuperRes(SuperResConfig(kind="paper"))
    alpha_channel = 128 + 1 + 64 + 1
    assert parameters(network) == 295_878 + alpha_channel
    affine_outputs = 32 + 128 + 128 + 128 + 64 + 64  # the layers' input channels: four convolutions, two toRGB
    assert 295_878 + affine_outputs * (45 + 1) + 4 == 320_906


def test_shapes_ranges_and_no_rays(field):
    seen = ask(field, inputs_of(50, 4))
    assert (seen.alpha.shape, seen.channels.shape, seen.depth.shape) == ((50,), (50, CHANNELS), (50,))
    assert (seen.alpha > 0).all()
    assert (seen.alpha < 1).all()
    assert (seen.channels[:, :3] > 0).all()
    assert (seen.channels[:, :3] < seen.alpha[:, None]).all()
    assert ask(field, inputs_of(0)).channels.shape == (0, CHANNELS)


def test_before_training_the_hand_is_solid_within_and_clear_without(field):
    within, _ = density_and_channels(field, inputs_of(200, height=torch.full((200,), -1.0)))
    without, _ = density_and_channels(field, inputs_of(200, height=torch.full((200,), 1.0)))
    assert within.min() * 3 > 5  # over the shell's 3 mm: nothing shines through
    assert without.max() * 3 < 0.1
    heights = torch.linspace(-1, 1, 9)
    means = [
        float(density_and_channels(field, inputs_of(50, height=torch.full((50,), float(h))))[0].detach().mean())
        for h in heights
    ]
    assert means == sorted(means, reverse=True)


@pytest.mark.parametrize("height", [-1e3, 0.0, 1e3])
def test_gradients_are_finite(field, height):
    seen = ask(field, inputs_of(10, 2, height=torch.full((20,), height)))
    (seen.alpha.sum() + seen.channels.sum()).backward()
    assert seen.alpha.isfinite().all()
    assert seen.channels.isfinite().all()
    assert all(p.grad is None or p.grad.isfinite().all() for p in field.parameters())


@pytest.mark.parametrize("kind", [PAPER, PLANES], ids=["paper", "planes"])
def test_density_does_not_depend_on_the_view(kind):
    torch.manual_seed(1)
    field = build_field(kind)
    one, other = (ask(field, inputs_of(20, 3, view=inputs_of(20, seed=seed).view)) for seed in (0, 9))
    assert torch.equal(one.alpha, other.alpha)
    assert torch.equal(one.depth, other.depth)
    assert not torch.equal(one.channels, other.channels)


def test_the_papers_field_sees_the_whole_pose_and_the_planes_the_local_one():
    torch.manual_seed(2)
    paper, planes = build_field(PAPER), build_field(PLANES)
    one = inputs_of(20)
    other_theta, other_local = one._replace(theta=one.theta + 0.5), one._replace(local_pose=one.local_pose + 0.5)
    assert not torch.equal(ask(paper, one).alpha, ask(paper, other_theta).alpha)
    assert torch.equal(ask(paper, one).alpha, ask(paper, other_local).alpha)
    assert torch.equal(ask(planes, one).alpha, ask(planes, other_theta).alpha)
    assert not torch.equal(ask(planes, one).alpha, ask(planes, other_local).alpha)
    lit = one._replace(light=one.light + 0.5)
    assert not torch.equal(ask(planes, one).channels, ask(planes, lit).channels)
    assert torch.equal(ask(paper, one).channels, ask(paper, lit).channels)


def test_rays_know_nothing_of_one_another(field):
    together = inputs_of(6, 4)
    alone = together._replace(
        **{name: getattr(together, name)[8:12] for name in ("uv", "height", "normal", "rotation")},
        **{name: getattr(together, name)[8:12] for name in ("local_pose", "light", "footprint_m")},
        view=together.view[2:3],
    )
    for one, whole in zip(ask(field, alone), ask(field, together), strict=True):
        torch.testing.assert_close(one[0], whole[2])


def test_planes_are_decoded_once_a_ray_from_the_mean_of_what_lies_along_it():
    """A ray whose samples are all alike looks like one sample of it; colour and features are the mean's."""
    torch.manual_seed(7)
    field = build_field(PLANES)
    decoded = []
    field.trunk[0].register_forward_hook(lambda layer, inputs, output: decoded.append(len(output)))
    one = inputs_of(5)
    sigma, channels = density_and_channels(field, one)
    of_frame = ("view", "theta", "place", "identity")
    per_sample = {name: getattr(one, name) for name in FieldInputs._fields if name not in of_frame}
    alike = one._replace(**{name: values.repeat_interleave(4, 0) for name, values in per_sample.items()})
    seen = ask(field, alike)
    assert decoded == [5, 5]
    torch.testing.assert_close(seen.alpha, 1 - torch.exp(-4 * STEP_MM * sigma), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(seen.channels / seen.alpha[:, None], channels, atol=1e-5, rtol=1e-3)


def test_planes_along_a_ray_written_out():
    """One sample after another, in plain arithmetic, from the planes' features to colour."""
    torch.manual_seed(8)
    field, inputs = build_field(PLANES).double(), inputs_of(1, 3)
    given = {name: values for name, values in inputs._asdict().items() if torch.is_tensor(values)}
    inputs = inputs._replace(**{name: values.double() for name, values in given.items()})
    offset = field.relief(inputs.uv, inputs.height, torch.ones(len(inputs.uv))) / 4
    planes = [plane(inputs.uv, inputs.height, torch.ones(len(inputs.uv))) for plane in field.planes]
    height = inputs.height[:, None]
    near = torch.cat([*planes, height, height * height, inputs.local_pose], 1)
    tilted = normalize(inputs.normal + torch.stack([inputs.rotation[k] @ offset[k] for k in range(3)]), dim=1)
    gathered = torch.cat([near, inputs.normal, tilted, inputs.light], 1)
    logit = field.density(torch.relu(field.near(near)))[:, 0] - 6 * inputs.height - 1
    through, alpha, mean = 1.0, 0.0, torch.zeros(gathered.shape[1], dtype=torch.float64)
    for k in range(3):
        opacity = 1 - torch.exp(-torch.nn.functional.softplus(logit[k]) * STEP_MM)
        alpha, mean, through = (
            alpha + through * opacity,
            mean + through * opacity * gathered[k],
            through * (1 - opacity),
        )
    mean = (mean / alpha)[None]
    normal = normalize(mean[:, near.shape[1] + 3 : near.shape[1] + 6], dim=1)
    hidden = torch.cat([mean, view_features(normal, inputs.view)], 1)
    for layer in field.trunk:
        hidden = torch.relu(layer(hidden))
    raw = field.channels(hidden)
    seen = ask(field, inputs)
    torch.testing.assert_close(seen.alpha, alpha[None], atol=1e-6, rtol=1e-5)
    expected = torch.cat([raw[:, :3].sigmoid(), raw[:, 3:]], 1) * alpha
    torch.testing.assert_close(seen.channels, expected, atol=1e-6, rtol=1e-5)


def test_a_ray_that_meets_nothing_is_decoded_to_nothing():
    field = build_field(PLANES)
    torch.nn.init.zeros_(field.density.weight)  # the prior alone: random weights may outweigh it so far out
    seen = ask(field, inputs_of(5, 2, height=torch.full((10,), 1e3)))
    assert (seen.alpha == 0).all()
    assert (seen.channels == 0).all()


def test_planes_finer_than_half_a_pixel_fade():
    """A plane counts in full while two of its texels span a pixel, then in inverse proportion to the pixel's size."""
    torch.manual_seed(3)
    field = build_field(FieldConfig(planes=((100, 1, 4), (400, 1, 4)), relief=8, atlas_m=0.2))
    texel_m = 0.2 / 400

    def read(footprint_m):
        inputs = inputs_of(10, footprint_m=torch.full((10,), footprint_m))
        return [field._read(plane, inputs, FeaturePlane.forward) for plane in field.feature_planes]

    near = read(texel_m)
    for footprint_m, share in ((2 * texel_m, 1.0), (4 * texel_m, 0.5), (16 * texel_m, 0.125)):
        coarse, fine = read(footprint_m)
        torch.testing.assert_close(fine, near[1] * share)
        torch.testing.assert_close(coarse, near[0] * min(1.0, 4 * share))


def test_relief_tilts_the_normal_in_the_canonical_hands_axes():
    torch.manual_seed(5)
    field = build_field(PLANES)
    inputs = inputs_of(30)
    with torch.no_grad():
        field.relief.table.zero_()
        torch.testing.assert_close(field._relief_normal(inputs, FeaturePlane.forward), inputs.normal)
        field.relief.table[:] = torch.tensor([0.4, -0.8, 1.2])
        expected = inputs.normal + inputs.rotation @ torch.tensor([0.1, -0.2, 0.3])
        torch.testing.assert_close(field._relief_normal(inputs, FeaturePlane.forward), normalize(expected, dim=-1))
        far = inputs._replace(footprint_m=torch.full((30,), 1e3))
        torch.testing.assert_close(field._relief_normal(far, FeaturePlane.forward), inputs.normal, atol=1e-4, rtol=0)


def test_turning_hand_and_relief_together_turns_the_tilted_normal():
    torch.manual_seed(6)
    field, inputs = build_field(PLANES), inputs_of(30)
    turn = axis_angle_to_matrix(torch.tensor([0.4, -1.0, 0.3]))
    turned = inputs._replace(normal=inputs.normal @ turn.T, rotation=turn @ inputs.rotation)
    torch.testing.assert_close(
        field._relief_normal(turned, FeaturePlane.forward), field._relief_normal(inputs, FeaturePlane.forward) @ turn.T
    )


def test_the_reflected_ray_obeys_the_law_of_reflection():
    generator = torch.Generator().manual_seed(4)
    normal = normalize(torch.randn(50, 3, generator=generator, dtype=torch.float64), dim=-1)
    view = normalize(torch.randn(50, 3, generator=generator, dtype=torch.float64), dim=-1)
    reflected, facing, grazing = view_features(normal, view).split([3, 1, 1], -1)
    torch.testing.assert_close(reflected.norm(dim=-1), torch.ones(50, dtype=torch.float64))
    torch.testing.assert_close((reflected * normal).sum(-1), -(view * normal).sum(-1))
    torch.testing.assert_close(torch.linalg.cross(reflected - view, normal), torch.zeros(50, 3, dtype=torch.float64))
    torch.testing.assert_close(facing[:, 0], -(view * normal).sum(-1))
    assert grazing.min() >= 0
    assert grazing.max() <= 1
    head_on = view_features(torch.tensor([[0.0, 0, 1]]), torch.tensor([[0.0, 0, -1]]))
    torch.testing.assert_close(head_on, torch.tensor([[0.0, 0, 1, 1, 0]]))


def test_the_local_pose_of_a_vertex_is_that_of_its_own_joints():
    skinning = Skinning.of(load_default_hand())
    theta = torch.zeros(16, 3)
    theta[2] = torch.tensor([0.3, -0.1, 0.7])  # the index finger's middle joint
    theta[0] = torch.tensor([9.0, 9, 9])  # the root is left out
    local = vertex_local_pose(theta, skinning)
    weights = skinning.lbs_weights
    torch.testing.assert_close(local[:, :3], weights[:, [2]] * theta[2])
    torch.testing.assert_close(local[:, 3:6], weights[:, [3]] * theta[2])  # seen from its child
    torch.testing.assert_close(local[:, 6:], weights[:, [1]] * theta[2])  # and from its parent
    knuckle = torch.zeros(16, 3)
    knuckle[[1, 4]] = 1.0
    from_the_wrist = vertex_local_pose(knuckle, skinning)[weights[:, 0] > 0.999]
    assert len(from_the_wrist) > 10
    assert from_the_wrist.abs().max() < 2e-3


def test_inputs_are_gathered_on_the_surface():
    hand = load_default_hand()
    topology = topology_of(hand)
    mesh = posed_mesh(topology, torch.as_tensor(hand.v_template, dtype=torch.float32))
    face = torch.arange(0, len(topology.faces), 20)
    barycentric = torch.rand(len(face), 3, generator=torch.Generator().manual_seed(0)) ** 3 + 1e-4
    barycentric[::2] = torch.tensor([0.0, 1.0, 0.0])
    barycentric = barycentric / barycentric.sum(1, keepdim=True)
    samples = SurfaceSamples(face, barycentric, torch.linspace(-0.002, 0.002, len(face)))
    visibility = ReferenceBackend().visibility(mesh, topology)
    frame = FrameConditions.of(torch.zeros(16, 3), Skinning.of(hand), topology, mesh, visibility)
    light = torch.arange(len(mesh.vertices), dtype=torch.float32)[:, None].expand(-1, LIGHT_CHANNELS)
    count = len(face)
    view = torch.zeros(count // 2, 3)  # of rays, passed through
    inputs = gather_field_inputs(samples, topology, frame, light, view, torch.ones(count), 0.002)
    assert inputs.view is view
    torch.testing.assert_close(inputs.height, samples.height_m / 0.002)
    torch.testing.assert_close(inputs.normal.norm(dim=-1), torch.ones(count))
    corners = topology.faces[face]
    torch.testing.assert_close(inputs.normal[::2], mesh.normals[corners[::2, 1]])
    torch.testing.assert_close(inputs.light[::2, 3], corners[::2, 1].float())
    torch.testing.assert_close(inputs.light[:, 0], (barycentric * corners).sum(1), rtol=1e-5, atol=1e-3)
    torch.testing.assert_close(inputs.uv, (barycentric[..., None] * topology.corner_uv[face]).sum(1))
    rest = local_rotations(mesh.vertices, mesh.normals, topology.frames)
    torch.testing.assert_close(rest, torch.eye(3).expand_as(rest), atol=1e-3, rtol=0)
    torch.testing.assert_close(inputs.rotation, torch.eye(3).expand(count, 3, 3), atol=1e-3, rtol=0)


@pytest.mark.slow
def test_the_poseless_field_never_hears_the_pose():
    field = build_field(replace(PLANES, pose=False))
    optimiser = torch.optim.Adam(field.parameters(), lr=0.01)
    for seed in range(3):
        field.zero_grad()
        seen = ask(field, inputs_of(20, 4, seed))
        (seen.channels.square().sum() + seen.alpha.sum()).backward()
        optimiser.step()
    one = inputs_of(20, 4, 7)
    other = one._replace(local_pose=one.local_pose + 0.5)
    assert torch.equal(ask(field, one).channels, ask(field, other).channels)
    assert torch.equal(ask(field, one).alpha, ask(field, other).alpha)
    assert not torch.equal(ask(field, one).channels, ask(field, one._replace(normal=-one.normal)).channels)
