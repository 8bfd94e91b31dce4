"""A person from pictures: the main road.

- light (`numbers`, `illumination`): of every scene, and the melanin of the skin in which it explains them best;
  of every picture, where it moves (`picture_lights`)
- gather (`gathering`): what pictures show of each texel
- numbers (`numbers`): blood; strength and tint of the light
- complete (`completion`): delighting with a prior, and what no picture shows; at the end with the contrast of the rest
- refit (`refit`; `skin_fit` of calibrated cameras): poses and shape, by flow from render to picture, and outlines
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import torch

from ..records.errors import LiveHandError
from ..records.hand_picture import PicturedHand
from ..records.light import Light
from ..surface.albedo_ratio import ratio_steps
from ..surface.atlas_masks import marks_map
from ..surface.atlas_texels import AtlasTexels
from ..surface.base_surface import whole_surface
from ..surface.shading_detail import log_albedo
from ..surface.skin_patches import RestPoints
from .albedo.agreement import GatheredRatio
from .albedo.completion import CompletedRatio, completed_ratio, with_unseen_detail
from .albedo.gathering import gathered_ratio
from .bases import Bases, family_at_base, shaped
from .fit.hand_size import with_mean_proportions
from .fit.refit import made_smaller, refitted
from .fit.stray_fingers import without_stray_fingers
from .kept_steps import FITTED_ROUND, FittedRound, KeptSteps
from .lit_model.illumination import (
    PICTURES_OF_SCENE,
    evenly_chosen,
    fitted_light,
    lamps_of,
    pixels_of_scenes,
)
from .lit_model.lamp_search import with_lamp
from .lit_model.model import PersonModel
from .lit_model.numbers import FIRST_MELANIN, AtlasTone, ToneFamily, fitted_melanin, looked_up
from .lit_model.picture_lights import PictureIlluminations, PixelsOfEach, fitted_lights, pixels_of_each
from .skin_fit import fitted_to_skin

_REPORTED = 1e-3
_LEAST_SEEN = 0.05

Log = Callable[[str], None]


class RoundOptions(NamedTuple):
    """How a round of light, gathering and completion is done.

    Attributes:
        resolution: of the atlas.
        pictures: that are gathered, at most.
        with_flow: as in `gathered_ratio`: harmful before the texture is the person's.
        levels: as in `gathered_ratio`.
        longest_px: side to which pictures are made smaller; None: their own.
    """

    resolution: int = 1024
    pictures: int = 36
    with_flow: bool = True
    levels: bool = False
    longest_px: int | None = None


_SMALL_PX = 420
COARSE_ROUND = RoundOptions(512, 16, with_flow=False, longest_px=_SMALL_PX)
"""Brings a skin so near that light and flow find the rest."""
LATER_ROUNDS = ((COARSE_ROUND,), (COARSE_ROUND, RoundOptions(512, 16)))
"""Before the later fits of poses, the last of which needs texture."""


@dataclass(frozen=True)
class MakingOptions:
    """How a person is made.

    Attributes:
        rounds: each begins with the skin of the one before, the first with one of the family.
        kept_low: as in `completed_ratio`.
        light_pictures: in which a scene's light is looked for.
        finds_lamps: look for a lamp beside the sky in each scene.
        lights_pictures: find how each picture's light differs from its scene's.
        fits_poses: fit poses and shape again, too.
        length_m: of the hand, where it was measured (`hand_size.sized`).
    """

    rounds: tuple[RoundOptions, ...] = (COARSE_ROUND, RoundOptions(levels=True))
    kept_low: float = 0.75
    light_pictures: int = PICTURES_OF_SCENE
    finds_lamps: bool = True
    lights_pictures: bool = True
    fits_poses: bool = True
    length_m: float | None = None


@dataclass(frozen=True)
class MadePerson:
    """What the pictures gave.

    Attributes:
        model: with the person's factor.
        texels: of the atlas.
        completed: the factor, its prior and confidence, the skin's numbers.
        gathered: of the last round.
        lights: of every picture, in the strength that the numbers give.
        lamps: by scene, of strength 1.
        pixels: of every picture, in each of its scene's lights; none, where pictures have no light of their own.
    """

    model: PersonModel
    texels: AtlasTexels
    completed: CompletedRatio
    gathered: GatheredRatio
    lights: PictureIlluminations
    lamps: Mapping[int, Sequence[Light]]
    pixels: PixelsOfEach

    @property
    def steps(self) -> np.ndarray:
        """[A, A, 3] int8 of the factor, as the model shows it."""
        steps = self.model.pipeline.steps
        assert steps is not None
        return steps


def made_person(
    base: PersonModel,
    hand: PicturedHand,
    family: ToneFamily,
    options: MakingOptions,
    log: Log = lambda line: None,
    before: MadePerson | None = None,
) -> MadePerson:
    """Make a person from pictures whose poses are known well enough for flow to correct the rest.

    Args:
        base: to begin with.
        hand: in the pictures.
        family: of skins.
        options: of the rounds.
        log: is told of each light and round.
        before: the person of an earlier fit of poses, whose lamps are taken, and pixels if its base is the same.
    """
    shown = [picture for picture in hand.pictures if not picture.is_held_out]
    pixels, base_log_albedo = pixels_of_scenes(base, shown, options.light_pictures), family_at_base(base)
    if before is not None:
        pixels = {scene: of_scene.with_sources(base, before.lamps[scene]) for scene, of_scene in pixels.items()}
    for scene, of_scene in pixels.items():
        log(f"light of scene {scene}: {len(of_scene.shown)} pixels of {len(of_scene.parts)} pictures")
    skin, made = None, None
    each = before.pixels if before is not None and before.model.avatar is base.avatar else {}
    for round_index, of_round in enumerate(options.rounds):
        texels = AtlasTexels.of(base.template.corner_uv, base.template.faces, of_round.resolution)
        skin = AtlasTone.of_family(texels, family, base_log_albedo) if skin is None else skin.on(texels)
        tones = {scene: skin.at(of_scene) for scene, of_scene in pixels.items()}
        skin = replace(skin, melanin=fitted_melanin(list(tones.values())))
        if options.finds_lamps and before is None and round_index == 0:
            tones = {scene: with_lamp(base, tone, skin.melanin) for scene, tone in tones.items()}
            pixels = {scene: tone.pixels for scene, tone in tones.items()}
            skin = replace(skin, melanin=fitted_melanin(list(tones.values())))
        fits = {scene: fitted_light(tone.pixels, tone.ratio(skin.melanin)) for scene, tone in tones.items()}
        if options.lights_pictures and not each:
            each = pixels_of_each(base, hand.pictures, pixels)
        lights = fitted_lights(pixels, fits, each, skin.ratios_at)
        model = base.with_ratio(_steps(texels, skin.log_ratio))
        pictures = [made_smaller(each, of_round.longest_px) for each in evenly_chosen(shown, of_round.pictures)]
        gathered = gathered_ratio(model, texels, pictures, lights, skin.log_ratio, of_round.with_flow, of_round.levels)
        _check_seen(gathered)
        completed = completed_ratio(texels, gathered, family, base_log_albedo, skin.melanin, options.kept_low)
        log(_report(round_index, gathered, completed))
        skin = replace(skin, bare=completed.log_ratio - skin.melanin * skin.per_melanin)
        gain, tint = completed.numbers.log_gain, np.exp(completed.numbers.log_tint)
        lights = lights.stronger(gain, tint)
        model = base.with_ratio(_steps(texels, skin.log_ratio))
        made = MadePerson(model, texels, completed, gathered, lights, lamps_of(pixels), each)
    assert made is not None
    return made


def _steps(texels: AtlasTexels, log_ratio: np.ndarray) -> np.ndarray:
    return ratio_steps(torch.as_tensor(texels.as_map(log_ratio))).numpy()


def person_of_pictures(
    bases: Bases,
    hand: PicturedHand,
    options: MakingOptions,
    log: Log = lambda line: None,
    steps: KeptSteps = KeptSteps(),  # noqa: B008
) -> tuple[MadePerson, PicturedHand]:
    """Make a person from pictures whose poses are about known; returns the pictures with poses and shape fitted, too.

    Early rounds see fewer pictures on a coarser atlas: they only bring poses, light and skin near enough for the next.
    Lamps are looked for once, as soon as poses are good.
    """
    if hand.is_calibrated:
        options = replace(
            options, lights_pictures=False, rounds=tuple(each._replace(with_flow=False) for each in options.rounds)
        )
    if options.fits_poses:
        hand = with_mean_proportions(hand, bases.nearest(FIRST_MELANIN).hand)
    if not hand.is_calibrated:
        hand = replace(hand, pictures=tuple(replace(picture, sighted=picture.pose) for picture in hand.pictures))
    early = replace(options, rounds=(COARSE_ROUND,), finds_lamps=False, lights_pictures=False)
    if not hand.is_calibrated:
        early = replace(early, light_pictures=_EARLY_LIGHT_PICTURES)
    melanin = FIRST_MELANIN
    for index, refits in enumerate(_refits(hand, options)):
        base = shaped(bases.nearest(melanin), hand)
        round_of = partial(_early_round, base, hand, bases.family, early, refits, log)
        fitted = steps.kept(f"round_{index + 1}", round_of, FITTED_ROUND)
        hand, melanin = fitted.fitted(hand), fitted.melanin
    made = None
    for index, rounds in enumerate(_later_rounds(hand, options)):
        base = shaped(bases.nearest(melanin), hand)
        of_rounds = replace(options, rounds=rounds, lights_pictures=options.lights_pictures and index > 0)
        made = made_person(base, hand, bases.family, of_rounds, log, made)
        if index == 0:
            hand = _with_mended_fingers(made, hand, log)
        hand = _refitted(made, hand, options.length_m, _LATER_REFITS[index], log, fits_offsets=True)
        melanin = made.completed.numbers.melanin
    base = shaped(bases.nearest(melanin), hand)
    return _with_unseen_detail(made_person(base, hand, bases.family, options, log, made)), hand


def _later_rounds(hand: PicturedHand, options: MakingOptions) -> tuple[tuple[RoundOptions, ...], ...]:
    return LATER_ROUNDS if options.fits_poses and not hand.is_calibrated else ()


def _with_unseen_detail(made: MadePerson) -> MadePerson:
    texels, base = made.texels, made.model.with_ratio(None)
    template, at_rest = base.template, base.at_detail(base.hand.v_template)
    points = RestPoints(1000 * texels.at_texels(at_rest), texels.at_texels(template.normals.numpy()))
    base_log_albedo = texels.at_texels(family_at_base(base)) + _fine_log_albedo(base, texels)
    completed = with_unseen_detail(texels, made.completed, base_log_albedo, points, *_nails_and_marks(made))
    return replace(made, completed=completed, model=made.model.with_ratio(_steps(texels, completed.log_ratio)))


def _fine_log_albedo(base: PersonModel, texels: AtlasTexels) -> np.ndarray:
    """Return the logarithm [T, 3] of what a base's detail maps multiply its albedo by."""
    row, column = np.divmod(texels.pixel, texels.resolution)
    uv = torch.as_tensor((np.stack([column, row], 1) + 0.5) / texels.resolution, dtype=torch.float32)
    surface = base.pipeline.surface
    assert surface is not None
    return log_albedo(surface.skin.maps_of("right"), uv, texels.resolution).numpy()


def _nails_and_marks(made: MadePerson) -> tuple[np.ndarray, np.ndarray]:
    """Find the texels [T] of nails, and those of marks of one hand alone."""
    surface, texels = made.model.avatar.surface, made.texels
    assert surface is not None
    nail = whole_surface(surface).arrays["nail"]
    marks = marks_map(texels, made.completed.log_ratio, made.completed.confidence, nail)
    row, column = np.divmod(texels.pixel, texels.resolution)
    return looked_up(nail > 0, row, column, texels.resolution), looked_up(marks > 0, row, column, texels.resolution)


def lines_of_making(hand: PicturedHand, options: MakingOptions) -> int:
    """Count the lines that `person_of_pictures` logs."""
    scenes = len({picture.scene for picture in hand.pictures})
    refits = _refits(hand, options)
    of_refits = 0 if hand.is_calibrated else sum(map(len, refits))
    later = _later_rounds(hand, options)
    of_later = sum(scenes + len(rounds) + 1 for rounds in later) + bool(later)
    return len(refits) * (scenes + 1) + of_refits + of_later + scenes + len(options.rounds)


def _refits(hand: PicturedHand, options: MakingOptions) -> tuple[_Refits, ...]:
    """Return the fits of poses in each early round."""
    if not options.fits_poses:
        return ((),)
    return _CALIBRATED_REFITS if hand.is_calibrated else _EARLY_REFITS


def _early_round(
    base: PersonModel,
    hand: PicturedHand,
    family: ToneFamily,
    options: MakingOptions,
    refits: _Refits,
    log: Log,
) -> FittedRound:
    made = made_person(base, hand, family, options, log)
    for longest_px in refits:
        if hand.is_calibrated:
            hand = fitted_to_skin(made.model, hand, made.lights)
        else:
            hand = _refitted(made, hand, options.length_m, longest_px, log)
    return FittedRound.of(hand, made.completed.numbers.melanin)


def _refitted(
    made: MadePerson,
    hand: PicturedHand,
    length_m: float | None,
    longest_px: int | None,
    log: Log,
    fits_offsets: bool = False,
) -> PicturedHand:
    refit = refitted(
        made.model,
        hand.pictures,
        made.lights,
        length_m=length_m,
        longest_px=longest_px,
        fits_offsets=fits_offsets,
    )
    log(f"poses and shape: flow was {refit.flow_px:.1f} px, masks overlapped by {refit.overlap:.3f}")
    return replace(hand, pictures=refit.pictures, offset_m=refit.offset_m if fits_offsets else hand.offset_m)


def _with_mended_fingers(made: MadePerson, hand: PicturedHand, log: Log) -> PicturedHand:
    mended, count = without_stray_fingers(made.model, hand.pictures, made.lights)
    log(f"fingers that were bent the wrong way: in {count} pictures")
    pairs = zip(mended, hand.pictures, strict=True)
    return replace(hand, pictures=tuple(new if new is old else replace(new, sighted=new.pose) for new, old in pairs))


_EARLY_LIGHT_PICTURES = 4
_Refits = tuple[int | None, ...]
"""The longer side of the pictures, px, in each fit of poses; None: their own. The first need nothing fine."""
_EARLY_REFITS, _CALIBRATED_REFITS = ((_SMALL_PX, _SMALL_PX),), ((None, None),)
_LATER_REFITS: _Refits = (_SMALL_PX, None)


def _check_seen(gathered: GatheredRatio) -> None:
    """Raise LiveHandError if so little skin was found that everything would be a guess."""
    seen = float((gathered.weight > _REPORTED).mean())
    if seen < _LEAST_SEEN or not np.isfinite(gathered.mean).all():
        raise LiveHandError(
            f"the pictures must show at least {_LEAST_SEEN:.0%} of the skin where the fitted hand is, got {seen:.0%}; "
            "show the whole hand, larger, sharp and in light"
        )


def _report(index: int, gathered: GatheredRatio, completed: CompletedRatio) -> str:
    numbers, seen = completed.numbers, (gathered.weight > _REPORTED).mean()
    return (
        f"round {index + 1}: {seen:.0%} of the skin seen, flow {gathered.flow_px:.2f} px, "
        f"spread {gathered.deviation:.3f}; melanin {numbers.melanin:.2f}, blood {numbers.blood:.2f}, "
        f"light x {np.exp(numbers.log_gain):.2f}, tint {np.exp(numbers.log_tint).round(3).tolist()}"
    )
