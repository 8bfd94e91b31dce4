"""The octahedral map: there and back, and on beyond its edges."""

import pytest
import torch
from livehand.backend.light.prefiltered_environment import from_square, on_square
from torch.nn.functional import normalize


def test_there_and_back():
    towards = normalize(torch.randn(5000, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    u, v = on_square(3 * towards)
    assert max(u.abs().max(), v.abs().max()) <= 1
    torch.testing.assert_close(from_square(u, v), towards, atol=1e-6, rtol=0)


@pytest.mark.parametrize("edge", [-1.0, 1.0])
@pytest.mark.parametrize("is_row", [False, True])
def test_beyond_an_edge_lies_what_the_sphere_has_there(edge, is_row):
    along, over = torch.linspace(-0.9, 0.9, 8), torch.full((8,), 0.02)

    def at(step):
        across = edge * (1 + step)
        return from_square(along, across) if is_row else from_square(across, along)

    inside, on, outside = at(-over), at(0 * over), at(over)
    # A small step over the edge goes on: it leads away from where it came from, and no farther than a step does.
    assert ((outside - on).norm(dim=-1) < 0.06).all()
    assert ((outside - inside).norm(dim=-1) > (outside - on).norm(dim=-1)).all()
    u, v = on_square(outside)
    across, back = (v, u) if is_row else (u, v)
    torch.testing.assert_close(across, edge * (1 - over), atol=1e-5, rtol=0)
    torch.testing.assert_close(back, -along, atol=1e-5, rtol=0)


def test_corners_are_one_point():
    corners = from_square(torch.tensor([-1.02, -1.02, 1.02, 1.02]), torch.tensor([-1.02, 1.02, -1.02, 1.02]))
    assert (corners[:, 2] < -0.99).all()
