"""The albedo of an invented person's skin: pigment and blood by place, veins, freckles, spots, and nails.

Pigments absorb exponentially, so that all of it adds up in logarithms. Colours are linear Rec.709.
"""

from __future__ import annotations

import numpy as np

from ..blood import PIGMENTED_LOG_ALBEDO, PLACE_LOG_ALBEDO
from ..detail_maps import DORSAL_SHADE, PALMAR_SHADE
from ..shading_detail import FOLD_LOG_ALBEDO
from .drawn_relief import DrawnRelief
from .hand_chart import THUMB, HandChart, bump, smoothstep
from .look import PersonLook
from .skin_lines import plane
from .solid_noise import SolidNoise

BLOOD, _THROUGH_PIGMENT = (np.array(colour, np.float32) for colour in (PLACE_LOG_ALBEDO, PIGMENTED_LOG_ALBEDO))
_YELLOW = np.array([0.0, -0.05, -0.36], np.float32)
_PIGMENT = np.array([0.55, 0.8, 1.0], np.float32)
_VEIN = np.array([-0.26, -0.06, 0.06], np.float32)
_BACK = np.array([[0.590, 0.338, 0.232], [0.118, 0.0445, 0.0215]], np.float32)  # of a light and of a deep skin
_PALM = np.array([[0.735, 0.500, 0.415], [0.455, 0.228, 0.131]], np.float32)
_ARM = np.array([[0.500, 0.290, 0.195], [0.112, 0.042, 0.0205]], np.float32)
_NAIL = {
    "bed": np.array([[0.690, 0.390, 0.325], [0.320, 0.158, 0.112]], np.float32),
    "moon": np.array([[0.740, 0.525, 0.455], [0.395, 0.245, 0.185]], np.float32),
    "flush": np.array([[0.620, 0.310, 0.260], [0.280, 0.130, 0.088]], np.float32),
    "free": np.array([[0.650, 0.520, 0.400], [0.445, 0.325, 0.235]], np.float32),
    "seen": np.array([[0.640, 0.465, 0.355], [0.370, 0.232, 0.158]], np.float32),  # flesh through the free edge
    "cuticle": np.array([[0.700, 0.465, 0.370], [0.180, 0.080, 0.045]], np.float32),
}
_IN_FOLDS = np.array([-0.28, -0.22, -0.16], np.float32)  # beyond the folds' own colour, which would be orange
_IN_CREASES = np.array([0.35, 0.5, 0.55], np.float32)  # pigment of the palm of a deep skin gathers there
_SPOT = np.array([[-0.42, -0.68, -0.80], [-0.55, -0.70, -0.75]], np.float32)  # of a freckle at its darkest
_PALE = 0.45, 0.97  # of the palm side, over which skin grows pale: pigment reaches round the edges
_ARM_PALM, _WRIST_MM, _SOFT_WRIST_MM = 0.35, (-26.0, 4.0), (-58.0, 14.0)  # of the chart's palm side; softer
_COARSE_FOLD = np.float32(0.65)  # of the folds' colour: blurred, all of it is too much
# How much more blood shows as much redness through deep pigment as through light.
_BELOW_PIGMENT = 0.7
_MOST_ALBEDO = 0.92
_LEAST_BLOOD = -0.34  # against the mean: paler skin would be grey
_SOFT, _SOFT_MEAN = 0.12, 0.03  # how softly it is approached, and what that adds in the mean
_MOON = np.array([0.55, 0.5, 0.1, 0.3, 1.0], np.float32)  # how large half-moons are, by digit
_HALF_NAIL_MM = np.array([5.5, 6.1, 5.6, 6.0, 7.2], np.float32)  # from its middle to its free end, by digit
_BLOOD_PURPOSE, _SPOT_PURPOSE, _NAIL_PURPOSE = 21, 22, 23


def drawn_log_albedo(chart: HandChart, relief: DrawnRelief, vein: np.ndarray, look: PersonLook) -> np.ndarray:
    """Draw the logarithm [T, 3] of the albedo, without the colour of folds.

    Args:
        chart: at the texels.
        relief: there.
        vein: [T] 1 where veins are highest.
        look: of the person.
    """
    noise = SolidNoise.of(look.random(_BLOOD_PURPOSE))
    outer = _mixed(look, _BACK) + chart.arm[:, None] * (_mixed(look, _ARM) - _mixed(look, _BACK))
    palm = 0.9 * (_pale(chart) * (1 - _web(chart)))[:, None]
    skin = outer + palm * (_mixed(look, _PALM) - outer)
    blood = look.blood - 1 + _blood(chart, noise, look)
    skin = skin + blood[:, None] * BLOOD + _yellow(chart, noise, look)[:, None] * _YELLOW
    brown = blood * (1 - chart.palm) * np.float32(min(look.tone, 1.0))
    skin = skin + brown[:, None] * _THROUGH_PIGMENT + _pigment(chart, noise, look)[:, None] * -_PIGMENT
    skin = skin + (_visible_veins(chart, vein) * (1 - 0.75 * min(look.tone, 1.0)))[:, None] * _VEIN
    skin = skin + _spots(chart, look)[:, None] * _mixed_linear(look, _SPOT)
    skin = skin + relief.furrow[:, None] * np.array([-0.10, -0.16, -0.18], np.float32)
    skin = skin + relief.dorsal[:, None] * _IN_FOLDS - (min(look.tone, 1.0) * relief.palmar)[:, None] * _IN_CREASES
    return _with_nails(chart, relief.nail_rim, noise, look, skin)


def _pale(chart: HandChart) -> np.ndarray:
    """Return how far the palm's paleness reaches [T]: not round the edges, and softly into the arm."""
    d = plane(chart.points_mm)[:, 0]
    drawn, soft = (_ARM_PALM + (1 - _ARM_PALM) * smoothstep(d, *ends) for ends in (_WRIST_MM, _SOFT_WRIST_MM))
    return smoothstep(chart.palm / drawn, *_PALE) * soft


def _web(chart: HandChart) -> np.ndarray:
    """Return where the back's pigment reaches over the edge of the thumb's web [T], which a fist turns outwards."""
    d, r = plane(chart.points_mm).T
    return bump(np.hypot((d - 66) / 17, (r - 29) / 15), 0.9) * smoothstep(chart.normals[:, 1], -0.85, -0.35)


def with_folds(log_albedo: np.ndarray, dorsal: np.ndarray, palmar: np.ndarray) -> np.ndarray:
    """Darken the skin [T, 3] in folds and creases of these depths [T], 1 at the deepest; nothing reflects all light."""
    shade = dorsal * DORSAL_SHADE + palmar * PALMAR_SHADE
    folds = shade[:, None] * (_COARSE_FOLD * np.array(FOLD_LOG_ALBEDO, np.float32))
    return np.minimum(log_albedo + folds, np.log(_MOST_ALBEDO)).astype(np.float32)


def _blood(chart: HandChart, noise: SolidNoise, look: PersonLook) -> np.ndarray:
    """Compute how much redder [T] the skin is than its mean: joints, tips and edges, and patches of three sizes."""
    own, joint = _place_strengths(look), chart.from_joint_mm
    d, r = plane(chart.points_mm).T
    tips = smoothstep(chart.along - chart.length[chart.digit], -22.0, -3.0) * chart.on_digit
    between = chart.on_digit * chart.palm * (bump(joint[:, 1] - 11, 6.0) + bump(joint[:, 1] + 13, 7.0))
    thenar = bump(np.hypot((d - 34) / 24, (r - 24) / 15), 0.6)
    ulnar = smoothstep(-r, 20.0, 34.0) * smoothstep(d, -5.0, 18.0) * smoothstep(d, 84.0, 62.0)
    pads = bump(d - 80, 7.0) * smoothstep(np.abs(r), 40.0, 30.0)
    hollow = bump(np.hypot((d - 48) / 22, (r + 4) / 13), 0.6)
    on_palm = (1 - chart.on_digit) * chart.palm * (1 - chart.arm)
    palm = on_palm * (0.45 * own[2] * thenar + 0.70 * own[3] * ulnar + 0.45 * own[4] * pads - 0.30 * own[5] * hollow)
    back = _joint_redness(chart, look) + 0.42 * own[7] * tips + 0.22 * own[4] * between
    fingers = (0.27 - 0.04 * look.tone) * own[8] * chart.on_digit * _dorsal(chart) * smoothstep(joint[:, 0], 2.0, 40.0)
    arm = (0.12 + 0.16 * look.tone) * smoothstep(d, 25.0, -25.0) * (1 - chart.palm)
    web = 0.8 * chart.on_digit * (1 - chart.on_digit) * (1 - _dorsal(chart))
    points, tone = chart.points_mm, look.tone * (1 - chart.palm)
    patches = (
        0.17 * (1 + 0.9 * tone) * noise.smooth(points, 42.0, 1)
        + 0.2 * (1 + 0.5 * tone) * noise.smooth(points[:, [1, 2, 0]], 15.0, 2)
        + 0.11 * (1 + 0.3 * tone) * noise.smooth(points[:, [2, 0, 1]], 6.0, 2)
        + (0.10 + 0.03 * chart.palm) * noise.smooth(points[:, [0, 2, 1]], 2.6, 3)
    )
    calm = 1 - 0.65 * smoothstep(d, 42.0, -10.0)
    patches = patches * (1 + (0.1 + 0.5 * look.tone) * chart.palm) * calm - 0.17 - 0.16 * tone
    total = (back + fingers + palm + web - arm) * _shown(chart, look) + patches
    return _LEAST_BLOOD + _SOFT * np.logaddexp(0, (total - _LEAST_BLOOD) / _SOFT) - _SOFT_MEAN


def joint_blood(chart: HandChart, look: PersonLook) -> np.ndarray:
    """Compute the blood [T] that makes joints red at rest, and leaves where bending makes their skin tight."""
    return _joint_redness(chart, look) * _shown(chart, look)


def _joint_redness(chart: HandChart, look: PersonLook) -> np.ndarray:
    own, joint = _place_strengths(look), chart.from_joint_mm
    on_top = bump(chart.lateral, 8.0) * smoothstep(np.abs(chart.lateral), 9.0, 4.5)
    knuckles = bump(joint[:, 0] - 1, 8.5) * on_top * (1 - chart.palm) * (chart.digit != THUMB)
    of_joints = 0.38 * own[0] * bump(joint[:, 1], 7.0) + 0.32 * own[1] * bump(joint[:, 2], 5.5)
    return 0.48 * own[6] * knuckles + chart.on_digit * _dorsal(chart) * of_joints


def _dorsal(chart: HandChart) -> np.ndarray:
    return smoothstep(chart.height, -0.1, 0.6)


def _shown(chart: HandChart, look: PersonLook) -> np.ndarray:
    """Return how much more blood it takes [T] to be seen through the pigment of a place."""
    return 1 + _BELOW_PIGMENT * look.tone * (1 - chart.palm)


def _place_strengths(look: PersonLook) -> np.ndarray:
    return look.random(_BLOOD_PURPOSE + 100).uniform(0.7, 1.3, 9)


def _yellow(chart: HandChart, noise: SolidNoise, look: PersonLook) -> np.ndarray:
    """Compute how much yellower [T]: patches, thick skin at the fingers' roots, and age."""
    d = plane(chart.points_mm)[:, 0]
    thick = chart.palm * (bump(d - 84, 6.0) * (1 - chart.on_digit) + 0.4 * chart.on_digit)
    patches = noise.smooth(chart.points_mm[:, [0, 2, 1]], 15.0, 2)
    return 0.15 * patches + 0.3 * thick + 0.15 * look.aged


def _pigment(chart: HandChart, noise: SolidNoise, look: PersonLook) -> np.ndarray:
    """Compute how much more pigment [T]: soft patches, darker joints; half as much on the arm, and none in the palm."""
    tone = min(look.tone, 1.0)
    patches = (0.07 + 0.08 * tone) * noise.smooth(chart.points_mm[:, [1, 0, 2]], 11.0, 2)
    patches += 0.07 * tone * noise.smooth(chart.points_mm[:, [2, 1, 0]], 28.0, 2)
    patches += (0.04 + 0.03 * tone) * noise.smooth(chart.points_mm[:, [0, 2, 1]], 2.4, 2)
    joint = chart.from_joint_mm
    over = chart.on_digit * smoothstep(chart.height, 0.1, 0.7) * (bump(joint[:, 1], 6.0) + 0.6 * bump(joint[:, 2], 4.5))
    return (1 - 0.8 * chart.palm) * ((1 - 0.5 * chart.arm) * patches + (0.05 + 0.34 * tone) * over)


def _visible_veins(chart: HandChart, vein: np.ndarray) -> np.ndarray:
    up = smoothstep(chart.normals[:, 1], 0.05, 0.5) * (1 - chart.on_digit)
    down = 0.6 * smoothstep(-chart.normals[:, 1], 0.2, 0.7) * smoothstep(-plane(chart.points_mm)[:, 0], -4.0, 8.0)
    return vein * np.maximum(up, down)


def _spots(chart: HandChart, look: PersonLook) -> np.ndarray:
    """Compute how dark [T] freckles, spots of age, and a few moles are, 1 at a freckle's darkest."""
    noise, total = SolidNoise.of(look.random(_SPOT_PURPOSE)), np.zeros(len(chart.palm), np.float32)
    at = (chart.palm < 0.6).nonzero()[0]
    points = chart.points_mm[at]
    edge = np.float32(0.12) * noise.smooth(points, 1.2, 2)
    sun = smoothstep(noise.smooth(points, 40.0, 1), -1.2, 1.2) * (1 - chart.palm[at]) * (1 - 0.6 * chart.on_digit[at])
    aged = look.aged
    kinds = (
        (1.7, 0.10 + 0.12 * look.freckles, 0.6 * look.freckles, (0.25, 0.70)),
        (8.0, 0.5 * aged, 0.8 * min(look.freckles, 1.5) * aged, (1.0, 3.0)),
        (12.0, 0.2, 2.2, (0.5, 1.0)),
    )
    for index, (size, share, strength, (least, most)) in enumerate(kinds):
        cells = noise.cells(points + np.float32(31.7 * index), (size, size, size))
        radius = least + (most - least) * cells.chance[:, 1] ** 2
        inside = smoothstep(size * cells.distance / radius + edge, 1.15, 0.6)
        present = cells.chance[:, 0] < share * (sun if index < 2 else 1)
        total[at] += np.float32(min(strength, 2.2)) * inside * present * (0.5 + 0.5 * cells.chance[:, 2])
    return total.clip(0, 2.2)


def _with_nails(chart: HandChart, rim: np.ndarray, noise: SolidNoise, look: PersonLook, skin: np.ndarray) -> np.ndarray:
    """Colour nails: bed, half-moon, flush before the free edge, the edge itself, and the cuticle on the plate."""
    colours = {name: _mixed(look, pair) for name, pair in _NAIL.items()}
    at = (rim < 1.35).nonzero()[0]
    along, across, near = chart.nail_along[at], chart.nail_across[at], rim[at]
    streaks = noise.smooth(np.stack([0.15 * along, across, chart.digit[at]], 1).astype(np.float32) * 8, 3.0, 2)
    sides = smoothstep(np.abs(across), 0.45, 1.0)
    bed = colours["bed"] + (0.08 * streaks + 0.14 * smoothstep(near, 0.6, 0.98) + 0.16 * sides)[:, None] * BLOOD
    bed = bed - np.float32(0.10 * min(look.tone, 1.0)) * smoothstep(streaks, -0.4, 1.4)[:, None] * _PIGMENT
    reach = 0.41 * _MOON[chart.digit[at]] - 0.93
    moon = smoothstep(along + 0.35 * across**2 - reach, 0.07, -0.07)
    nail = _towards(bed, colours["moon"], 0.85 * moon)
    nail = _with_free_edge(nail, colours, _free_edge_mm(chart, noise, look, at))
    nail = nail + np.float32(0.5 * look.aged) * (0.3 * _YELLOW + np.array([-0.06, -0.06, -0.06], np.float32))
    cuticle = smoothstep(near, 0.90, 0.97) * smoothstep(along, 0.0, -0.5)
    nail = _towards(nail, colours["cuticle"], 0.6 * cuticle)
    flesh = skin[at] + (bump(near - 1.12, 0.08) * smoothstep(along, 1.1, 0.7) * 0.2)[:, None] * BLOOD
    coloured = skin.copy()
    coloured[at] = _towards(flesh, nail, smoothstep(near, 1.02, 0.97))
    return coloured


def _free_edge_mm(chart: HandChart, noise: SolidNoise, look: PersonLook, at: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return how far [N] texels `at` lie beyond the border of the nail's bed, and its length there, mm."""
    digit, across = chart.digit[at], chart.nail_across[at]
    random, half_mm = look.random(_NAIL_PURPOSE), _HALF_NAIL_MM[digit]
    length_mm = (look.nails + 0.25) * random.uniform(0.85, 1.15, 5)[digit]
    bow_mm = random.uniform(0.08, 0.22, 5)[digit] * half_mm * across**2
    place = np.stack([np.zeros_like(across), 4 * across, 40.0 * digit], 1).astype(np.float32)
    wave_mm = np.float32(0.12) * noise.smooth(place, 6.0, 1)
    return (chart.nail_along[at] - 1) * half_mm + length_mm + bow_mm + wave_mm, length_mm + bow_mm


def _with_free_edge(nail: np.ndarray, colours: dict[str, np.ndarray], edge_mm: tuple[np.ndarray, ...]) -> np.ndarray:
    """Colour the plate beyond its bed: flesh shows through it, less towards its end; a pale band and a flush before."""
    beyond, length = edge_mm
    nail = _towards(nail, colours["flush"], 0.5 * bump(beyond + 1.0, 0.5))
    nail = _towards(nail, colours["seen"], 0.55 * bump(beyond + 0.25, 0.22))
    edge = colours["seen"] + (0.25 + 0.75 * smoothstep(beyond / length, 0.0, 0.75))[:, None] * (
        colours["free"] - colours["seen"]
    )
    return _towards(nail, edge, 0.9 * smoothstep(beyond, -0.30, 0.35))


def _towards(start: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    return start + share[:, None].astype(np.float32) * (end - start)


def _mixed(look: PersonLook, light_and_deep: np.ndarray) -> np.ndarray:
    """Mix two colours [2, 3] by the person's tone; returns the logarithm [3]."""
    return _mixed_linear(look, np.log(light_and_deep))


def _mixed_linear(look: PersonLook, light_and_deep: np.ndarray) -> np.ndarray:
    return ((1 - look.tone) * light_and_deep[0] + look.tone * light_and_deep[1]).astype(np.float32)
