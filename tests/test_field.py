"""The two fields: sizes as published, the density prior, what they depend on and what they do not."""

import pytest
import torch
from livehand.backend.field.conditions import (
    EXPOSURE_CHANNELS,
    LOCAL_POSE_CHANNELS,
    FieldInputs,
    FrameConditions,
    field_inputs,
    vertex_local_pose,
    view_features,
)
from livehand.backend.field.field import CHANNELS, FieldConfig, build_field
from livehand.backend.geometry.local_rotation import local_rotations
from livehand.backend.geometry.mesh import Topology, posed_mesh
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.geometry.uvh import project_to_surface
from livehand.backend.hand.model import load_default_hand
from livehand.backend.superres import PaperSuperRes
from torch.nn.functional import normalize

PAPER, PLANES = FieldConfig(kind="paper"), FieldConfig(planes=((64, 6, 8), (128, 3, 8), (256, 1, 4)), relief=64)


def inputs_of(count, seed=0, exposure=EXPOSURE_CHANNELS, **changes):
    generator = torch.Generator().manual_seed(seed)

    def rand(*shape):
        return torch.rand(*shape, generator=generator)

    inputs = FieldInputs(
        uv=rand(count, 2),
        height=rand(count) * 2 - 1,
        normal=normalize(rand(count, 3) - 0.5, dim=-1),
        rotation=axis_angle_to_matrix(rand(count, 3)),
        local_pose=rand(count, LOCAL_POSE_CHANNELS) - 0.5,
        exposure=rand(count, exposure),
        view=normalize(rand(count, 3) - 0.5, dim=-1),
        theta=rand(48) - 0.5,
        footprint_m=torch.full((count,), 5e-4),
    )
    return inputs._replace(**changes)


def parameters(network):
    return sum(parameter.numel() for parameter in network.parameters())


@pytest.fixture(params=[PAPER, PLANES], ids=["paper", "planes"])
def field(request):
    torch.manual_seed(0)
    return build_field(request.param)


def test_the_papers_field_has_the_papers_size():
    assert parameters(build_field(PAPER)) == 92_577


def test_the_papers_superresolution_has_the_papers_size_but_for_the_folded_modulation():
    """320,906 published; folding drops the affine maps of 6 modulated layers (45 + 1 inputs each) and 4 noise gains."""
    network = PaperSuperRes()
    alpha_channel = 128 + 1 + 64 + 1
    assert parameters(network) == 295_878 + alpha_channel
    affine_outputs = 32 + 128 + 128 + 128 + 64 + 64  # the layers' input channels: four convolutions, two toRGB
    assert 295_878 + affine_outputs * (45 + 1) + 4 == 320_906


def test_shapes_ranges_and_no_samples(field):
    sigma, channels = field(inputs_of(50))
    assert (sigma.shape, channels.shape) == ((50,), (50, CHANNELS))
    assert (sigma >= 0).all()
    assert (channels[:, :3] > 0).all()
    assert (channels[:, :3] < 1).all()
    assert field(inputs_of(0))[1].shape == (0, CHANNELS)


def test_before_training_the_hand_is_solid_within_and_clear_without(field):
    within, _ = field(inputs_of(200, height=torch.full((200,), -1.0)))
    without, _ = field(inputs_of(200, height=torch.full((200,), 1.0)))
    assert within.min() * 3 > 5  # over the shell's 3 mm: nothing shines through
    assert without.max() * 3 < 0.1
    heights = torch.linspace(-1, 1, 9)
    means = [float(field(inputs_of(50, height=torch.full((50,), float(h))))[0].detach().mean()) for h in heights]
    assert means == sorted(means, reverse=True)


@pytest.mark.parametrize("height", [-1e3, 0.0, 1e3])
def test_gradients_are_finite(field, height):
    sigma, channels = field(inputs_of(20, height=torch.full((20,), height)))
    (sigma.sum() + channels.sum()).backward()
    assert sigma.isfinite().all()
    assert all(p.grad is None or p.grad.isfinite().all() for p in field.parameters())


@pytest.mark.parametrize("kind", [PAPER, PLANES], ids=["paper", "planes"])
def test_density_does_not_depend_on_the_view(kind):
    torch.manual_seed(1)
    field = build_field(kind)
    one, other = inputs_of(20), inputs_of(20)._replace(view=inputs_of(20, seed=9).view)
    assert torch.equal(field(one)[0], field(other)[0])
    assert not torch.equal(field(one)[1], field(other)[1])


def test_the_papers_field_sees_the_whole_pose_and_the_planes_the_local_one():
    torch.manual_seed(2)
    paper, planes = build_field(PAPER), build_field(PLANES)
    one = inputs_of(20)
    other_theta, other_local = one._replace(theta=one.theta + 0.5), one._replace(local_pose=one.local_pose + 0.5)
    assert not torch.equal(paper(one)[0], paper(other_theta)[0])
    assert torch.equal(paper(one)[0], paper(other_local)[0])
    assert torch.equal(planes(one)[0], planes(other_theta)[0])
    assert not torch.equal(planes(one)[0], planes(other_local)[0])
    lit = one._replace(exposure=one.exposure + 0.5)
    assert not torch.equal(planes(one)[1], planes(lit)[1])
    assert torch.equal(paper(one)[1], paper(lit)[1])


def test_planes_finer_than_half_a_pixel_fade():
    """A plane counts in full while two of its texels span a pixel, then in inverse proportion to the pixel's size."""
    torch.manual_seed(3)
    field = build_field(FieldConfig(planes=((100, 1, 4), (400, 1, 4)), relief=8, atlas_m=0.2))
    texel_m = 0.2 / 400

    def read(footprint_m):
        return field._read(inputs_of(10, footprint_m=torch.full((10,), footprint_m)))

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
        torch.testing.assert_close(field._relief_normal(inputs), inputs.normal)
        field.relief.table[:] = torch.tensor([0.4, -0.8, 1.2])
        expected = inputs.normal + inputs.rotation @ torch.tensor([0.1, -0.2, 0.3])
        torch.testing.assert_close(field._relief_normal(inputs), normalize(expected, dim=-1))
        far = inputs._replace(footprint_m=torch.full((30,), 1e3))
        torch.testing.assert_close(field._relief_normal(far), inputs.normal, atol=1e-4, rtol=0)


def test_turning_hand_and_relief_together_turns_the_tilted_normal():
    torch.manual_seed(6)
    field, inputs = build_field(PLANES), inputs_of(30)
    turn = axis_angle_to_matrix(torch.tensor([0.4, -1.0, 0.3]))
    turned = inputs._replace(normal=inputs.normal @ turn.T, rotation=turn @ inputs.rotation)
    torch.testing.assert_close(field._relief_normal(turned), field._relief_normal(inputs) @ turn.T)


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
    hand = load_default_hand()
    topology = Topology.of(hand)
    theta = torch.zeros(16, 3)
    theta[2] = torch.tensor([0.3, -0.1, 0.7])  # the index finger's middle joint
    theta[0] = torch.tensor([9.0, 9, 9])  # the root says nothing
    local = vertex_local_pose(theta, topology)
    weights = topology.lbs_weights
    torch.testing.assert_close(local[:, :3], weights[:, [2]] * theta[2])
    torch.testing.assert_close(local[:, 3:6], weights[:, [3]] * theta[2])  # seen from its child
    torch.testing.assert_close(local[:, 6:], weights[:, [1]] * theta[2])  # and from its parent
    knuckle = torch.zeros(16, 3)
    knuckle[[1, 4]] = 1.0
    from_the_wrist = vertex_local_pose(knuckle, topology)[weights[:, 0] > 0.999]
    assert len(from_the_wrist) > 10
    assert from_the_wrist.abs().max() < 2e-3


def test_inputs_are_gathered_on_the_surface():
    hand = load_default_hand()
    topology = Topology.of(hand)
    mesh = posed_mesh(topology, torch.as_tensor(hand.v_template, dtype=torch.float32))
    samples = project_to_surface(mesh.vertices[1::10] + 0.001 * mesh.normals[1::10], topology, mesh)
    frame = FrameConditions.of(torch.zeros(16, 3), topology, mesh)
    exposure = torch.arange(len(mesh.vertices), dtype=torch.float32)[:, None].expand(-1, EXPOSURE_CHANNELS)
    count = len(samples.face)
    inputs = field_inputs(samples, topology, frame, exposure, torch.zeros(count, 3), torch.ones(count), 0.002)
    torch.testing.assert_close(inputs.height, samples.height_m / 0.002)
    torch.testing.assert_close(inputs.normal.norm(dim=-1), torch.ones(count))
    assert ((inputs.normal * mesh.normals[1::10]).sum(-1) > 0.9).double().mean() > 0.98
    rest = local_rotations(mesh.vertices, mesh.normals, topology.frames)
    torch.testing.assert_close(rest, torch.eye(3).expand_as(rest), atol=1e-3, rtol=0)
    torch.testing.assert_close(inputs.rotation, torch.eye(3).expand(count, 3, 3), atol=1e-3, rtol=0)
    near = (mesh.vertices[topology.faces[samples.face]] - mesh.vertices[1::10][:, None]).norm(dim=-1).amin(1)
    assert near.max() < 1e-3
    corner = topology.faces[samples.face].gather(1, samples.barycentric.argmax(1, keepdim=True))[:, 0]
    is_at_corner = samples.barycentric.amax(1) > 0.9999
    assert is_at_corner.any()
    torch.testing.assert_close(inputs.exposure[is_at_corner, 0], corner[is_at_corner].float(), atol=1.0, rtol=1e-3)
