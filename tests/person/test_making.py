"""A made person's pictures, by our own renderer: colours, light and numbers come back, and the avatar shows them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.capture.picture import linear_to_srgb
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.person import making, review
from livehand.backend.person.bases import family_at_base
from livehand.backend.person.fit.refit import refitted
from livehand.backend.person.lit_model.numbers import AtlasTone
from livehand.backend.person.lit_model.picture_lights import PictureIlluminations
from livehand.backend.person.making import (
    MakingOptions,
    RoundOptions,
    lines_of_making,
    made_person,
)
from livehand.backend.person.person_avatar import person_avatar, shipped_bases
from livehand.backend.person.review import held_out_figures, write_sheet
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Lamp, Light, Sky, rotation_facing, sky_directions
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.surface.albedo_ratio import RATIO_STEP
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.tests.person.conftest import pictured

pytest.importorskip("cv2")
pytestmark = pytest.mark.slow
# Steps of the logarithm between both halves of the atlas; three times as strong, it is taken for .15 of melanin.
STAIN = np.array([-10, -16, -16], np.int8)


@pytest.fixture(scope="module")
def bases():
    return shipped_bases(load_default_hand())


@pytest.fixture(scope="module")
def truth(bases):
    steps = np.zeros((256, 256, 3), np.int8)
    steps[:, :128], steps[:, 128:] = STAIN // 2, -STAIN // 2
    return bases.models[0.42].with_ratio(steps)


def light():
    up = sky_directions(16, 32)[..., 2:]
    return Light(sky=Sky(np.repeat(0.25 + 0.2 * up.clip(0), 3, 2)))


@pytest.fixture(scope="module")
def hand(truth):
    """Views of a resting hand from all around, the last held out."""
    return pictured(truth, light())


@pytest.fixture(scope="module")
def made(bases, hand):
    options = MakingOptions(rounds=(RoundOptions(256, 36, with_flow=False),), finds_lamps=False)
    told = []
    made = made_person(bases.models[0.42], hand, bases.family, options, told.append)
    # `person_of_pictures` makes an early one, too.
    assert 2 * len(told) == lines_of_making(hand, replace(options, fits_poses=False))
    return made


def test_a_frame_is_the_sum_of_its_parts(truth, hand):
    picture = hand.pictures[1]
    whole = truth.rendered(picture.pose, picture.camera, light())
    ((diffuse, specular),) = truth.rendered_parts(picture.pose, picture.camera, [light()])
    np.testing.assert_allclose(diffuse.rgb + specular.rgb, whole.rgb, atol=1e-5)
    np.testing.assert_array_equal(diffuse.alpha, whole.alpha)
    assert 0.02 < specular.rgb.sum() / whole.rgb.sum() < 0.5


def test_the_numbers_come_back(made):
    assert made.completed.numbers.melanin == pytest.approx(0.42, abs=0.2)
    assert (made.completed.confidence > 0.5).mean() > 0.5


def test_a_stain_stands_where_it_was(made):
    """Its border; half of what is coarse is taken for light, so that about half of the step is left."""
    column = made.texels.pixel % 256
    sure = made.completed.confidence > 0.5
    left, right = ((column >= low) & (column < high) & sure for low, high in ((116, 127), (130, 141)))
    step = made.completed.log_ratio[left].mean(0) - made.completed.log_ratio[right].mean(0)
    assert (step < 0.3 * STAIN * RATIO_STEP).all()


def test_a_held_out_picture_is_shown(made, hand, tmp_path):
    figures = held_out_figures(made.model, hand.pictures, made.lights)
    assert figures.pictures == 1
    assert figures.psnr_db > 26
    assert figures.overlap > 0.97
    sheet = tmp_path / "new" / "sheet.png"
    write_sheet(sheet, made, hand.pictures, "made")
    assert sheet.stat().st_size > 10_000
    with pytest.raises(LiveHandError, match=r"must be writable"):
        write_sheet(sheet / "sheet.png", made, hand.pictures, "made")


def test_the_sheet_shows_the_person_in_all_of_the_light_that_was_found(made, hand):
    picture = hand.pictures[2]
    found = made.lights.at(picture)
    towards = picture.camera.cam2world[:3, :3] @ [0, 0, 1.0]
    lamp = Lamp("sun", np.full(3, 2.0), rotation=rotation_facing(-towards))
    lit = replace(found, lamps=(lamp,), tint=np.array([0.9, 1.0, 1.1]))
    lit_so = PictureIlluminations({0: lit})
    frame = made.model.rendered(picture.pose, picture.camera, lit.tinted)
    shown = linear_to_srgb((frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)).clip(0, 1))
    filmed = replace(picture, rgb=(255 * shown).round().astype(np.uint8), log_gain=(0.0, 0.0, 0.0))
    above, below = (part.astype(int) for part in review._pair(replace(made, lights=lit_so), filmed, lit_so))
    assert above.mean() > review._pair(made, filmed, made.lights)[1].mean() + 5
    assert np.abs(above - below).mean() < 1


def test_the_avatar_is_the_person_after_its_file_too(made, hand, tmp_path):
    avatar = person_avatar(made, made.model.hand, np.zeros(10), "made", "right", {"source": "made", "consent": "mine"})
    save_avatar(avatar, tmp_path / "made.safetensors")
    loaded = load_avatar(tmp_path / "made.safetensors")
    assert loaded.provenance["consent"] == "mine"
    picture = hand.pictures[2]
    vertices = posed_vertices(made.model.hand, picture.pose)
    shot = Shot(picture.pose, vertices, picture.camera, light())
    ours, theirs = (
        Renderer(one, made.model.hand, "cpu").render(shot).rgb for one in (loaded, replace(avatar, thumbnail=None))
    )
    np.testing.assert_allclose(ours, theirs, atol=2e-3)
    model = made.model.rendered(picture.pose, picture.camera, light()).rgb
    assert np.abs(theirs - model).mean() < 0.01  # the same but for the numbers that shape fine pigment


def test_a_finer_atlas_begins_with_the_skin_of_the_coarser(bases, made):
    base = bases.models[0.42]
    coarse = AtlasTexels.of(base.template.corner_uv, base.template.faces, 128)
    tones = [AtlasTone.of_family(texels, bases.family, family_at_base(base)) for texels in (coarse, made.texels)]
    tones[0] = replace(tones[0], bare=tones[0].bare + 1.0, melanin=0.7)
    finer = tones[0].on(made.texels)
    assert finer.melanin == 0.7
    assert np.abs(finer.bare - tones[1].bare - 1.0).mean() < 0.05  # about what neighbours differ by
    assert np.abs(finer.per_melanin - tones[1].per_melanin).mean() < 0.05


@pytest.mark.parametrize(("longest_px", "left"), [(None, 0.3), (130, 0.6)])  # flow in a smaller picture is coarser
def test_poses_go_back_to_where_the_pictures_show_them(made, hand, longest_px, left):
    rng = np.random.default_rng(1)
    right = rest_wrists(made.model.hand, np.zeros(10))
    assert np.isfinite(right).all()
    moved = tuple(
        replace(one, pose=replace(one.pose, transl=one.pose.transl + rng.normal(0, 0.004, 3))) for one in hand.pictures
    )
    before = np.mean([np.linalg.norm(one.pose.transl) for one in moved])
    once = refitted(made.model, moved, made.lights, longest_px=longest_px)
    found = refitted(made.model, once.pictures, made.lights, longest_px=longest_px)

    def off_px(pictures):
        points = posed_vertices(made.model.hand, HandPose.rest())
        return np.array(
            [
                np.linalg.norm(
                    one.camera.project(posed_vertices(made.model.hand, one.pose))[0] - one.camera.project(points)[0],
                    axis=1,
                ).mean()
                for one in pictures
            ]
        )

    assert before > 0.002
    assert off_px(found.pictures).mean() < left * off_px(moved).mean()
    if longest_px is None:
        assert (off_px(found.pictures) < off_px(moved)).all()
    assert torch.is_grad_enabled()


@pytest.mark.nightly
def test_the_whole_road_fits_poses_to_texture_and_keeps_its_lamps(bases, hand, monkeypatch):
    """It tells every line that it counts; lamps are looked for once."""
    coarse = making.COARSE_ROUND._replace(resolution=256)
    monkeypatch.setattr(making, "COARSE_ROUND", coarse)
    monkeypatch.setattr(making, "LATER_ROUNDS", ((coarse,), (coarse, coarse._replace(with_flow=True))))
    given, told = [], []
    once = making.made_person

    def watched(*arguments):
        result = once(*arguments)
        given.append((arguments[-1], result.lamps))
        return result

    monkeypatch.setattr(making, "made_person", watched)
    options = MakingOptions(rounds=(RoundOptions(256, 36),))
    hand = replace(hand, is_calibrated=False)
    made, fitted = making.person_of_pictures(bases, hand, options, told.append)
    assert len(told) == lines_of_making(hand, options)
    assert len(given) == 4
    (nothing, found), (shared, _), (last, kept) = given[1:]
    assert nothing is None
    assert shared is found
    assert last == kept == found
    off_m = [
        np.linalg.norm(posed_vertices(made.model.hand, a.pose) - posed_vertices(made.model.hand, b.pose), axis=1).mean()
        for a, b in zip(fitted.pictures, hand.pictures, strict=True)
    ]
    assert np.mean(off_m) < 0.005  # landmarks: 0.01
