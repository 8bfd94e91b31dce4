"""The picture that an avatar's file carries."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.library import SKINS, shipped_avatar_path
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.avatars.thumbnail import SIDE_PX, with_thumbnail
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.rendering.renderer import Renderer
from livehand.backend.runtime.command import run_commands
from livehand.livehand_blender.cli import COMMANDS


@pytest.fixture(scope="module")
def taken():
    return render_thumbnail(Renderer(load_avatar(), load_default_hand(), "cpu"))


def test_it_shows_the_whole_hand_fingers_up(taken):
    assert taken.shape == (SIDE_PX, SIDE_PX, 4)
    assert taken.dtype == np.uint8
    rows, columns = np.nonzero(taken[..., 3] > 128)
    assert 0.85 * SIDE_PX < np.ptp(rows) < SIDE_PX - 2
    assert columns.min() > 1
    assert columns.max() < SIDE_PX - 2
    hand = taken[..., 3] > 128
    assert hand[: SIDE_PX // 3].sum() < hand[SIDE_PX // 3 : 2 * SIDE_PX // 3].sum()  # fingers above the palm


def test_it_shows_the_skin(taken):
    """The light skin's mean, encoded, redder than green than blue; nothing is shown where there is no hand."""
    skin = taken[taken[..., 3] == 255][:, :3].mean(0)
    assert skin[0] > skin[1] + 20 > skin[2] + 20
    assert 120 < skin[0] < 230
    assert taken[0, 0, 3] == 0


@pytest.mark.parametrize("skin", SKINS)
def test_shipped_avatars_carry_theirs(skin):
    path = shipped_avatar_path(skin)
    carried = read_metadata(path).thumbnail
    assert carried is not None
    now = render_thumbnail(Renderer(load_avatar(path), load_default_hand(), "cpu"))
    assert np.abs(carried.astype(int) - now).mean() < 1  # of 255; bf16 and other processors may differ a little


def test_it_survives_the_file(tmp_path, taken):
    save_avatar(replace(load_avatar(), thumbnail=taken), tmp_path / "a.safetensors")
    back = load_avatar(tmp_path / "a.safetensors").thumbnail
    assert back is not None
    np.testing.assert_array_equal(back, taken)


def test_a_refined_surface_is_no_hindrance(taken):
    """The avatar then belongs to the refined hand, which a training has not loaded."""
    refined = with_thumbnail(replace(load_avatar(), hand_sha256="ab" * 32), load_default_hand(), "cpu")
    assert refined.hand_sha256 == "ab" * 32
    np.testing.assert_array_equal(refined.thumbnail, taken)


def test_the_command_takes_it_and_keeps_everything_else(tmp_path, taken):
    path = tmp_path / "a.safetensors"
    before = replace(load_avatar(), thumbnail=None)
    save_avatar(before, path)
    assert read_metadata(path).thumbnail is None
    assert run_commands("livehand", "", COMMANDS, ["thumbnail", str(path), "--device", "cpu"]) == 0
    after = load_avatar(path)
    np.testing.assert_array_equal(after.thumbnail, taken)
    assert (after.metrics, after.provenance, after.name) == (before.metrics, before.provenance, before.name)
    for key, value in before.field.state_dict().items():
        assert (after.field.state_dict()[key] == value).all()


def test_the_command_refuses_another_hand(tmp_path, capsys):
    path = tmp_path / "a.safetensors"
    save_avatar(replace(load_avatar(), hand_sha256="ab" * 32), path)
    before = path.read_bytes()
    assert run_commands("livehand", "", COMMANDS, ["thumbnail", str(path)]) == 1
    assert "must be given its own hand model" in capsys.readouterr().err
    assert path.read_bytes() == before
