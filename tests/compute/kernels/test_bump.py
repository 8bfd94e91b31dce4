"""Bent normals by the kernel: those of the reference, at every bend and from everywhere."""

import numpy as np
import torch
from livehand.backend.compute.kernels.bump import bump_shadowing, leaving_share, mirroring_normal
from livehand.backend.light import bump
from torch.nn.functional import normalize

COUNT = 2000


def units(seed):
    return normalize(torch.randn(COUNT, 3, generator=torch.Generator().manual_seed(seed)), dim=-1)


def along(normal, surface):
    return (normal * surface).sum(-1).numpy()


def test_normals_are_bent_back_as_by_the_reference():
    surface, view = units(0), units(1)
    normal = normalize(surface + 0.7 * units(2), dim=-1)
    expected, found = bump.mirroring_normal(normal, surface, view), np.empty((COUNT, 3), np.float32)
    for index, row in enumerate(
        zip(normal.numpy(), surface.numpy(), view.numpy(), along(normal, surface), strict=True)
    ):
        mirroring_normal(*row, found[index])
    assert 300 < (expected != normal).any(1).sum() < COUNT - 300
    torch.testing.assert_close(torch.as_tensor(found), expected, atol=2e-5, rtol=0)


def test_what_remains_of_a_light_is_that_of_the_reference():
    surface, towards = units(3), units(4)
    normal = normalize(surface + 0.7 * units(5), dim=-1)
    facing = along(normal, towards)
    rows = zip(facing, *towards.numpy().T, along(normal, surface), surface.numpy(), strict=True)
    found = torch.tensor([bump_shadowing(*row) for row in rows])
    torch.testing.assert_close(found, bump.bump_shadowing(normal, surface, towards), atol=1e-4, rtol=0)
    assert 100 < ((found > 0.01) & (found < 0.99)).sum()


def test_what_leaves_the_surface_of_a_lobe_is_that_of_the_reference():
    surface, view = units(6), units(7)
    normal = normalize(surface + 0.7 * units(8), dim=-1)
    squared = 0.01 + 0.2 * torch.rand(COUNT, 1, generator=torch.Generator().manual_seed(9))
    to_eye = -along(normal, view)
    above = along(surface, view) + 2 * to_eye * along(normal, surface)
    found = torch.tensor([leaving_share(*row) for row in zip(above, to_eye, squared[:, 0].numpy(), strict=True)])
    torch.testing.assert_close(found, bump.leaving_share(normal, surface, view, squared)[:, 0], atol=1e-4, rtol=1e-3)
    assert 100 < ((found > 0.01) & (found < 0.99)).sum()
