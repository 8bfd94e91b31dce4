"""The relief of an invented person's skin: cells, ridges, folds, creases and nails' rims, by place and age.

Everything is drawn from the person's seed; only where joints fold is every hand's own anatomy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .hand_chart import THUMB, HandChart, bump, smoothstep
from .look import PersonLook
from .skin_lines import PlaneImage, palm_creases, plane
from .solid_noise import SolidNoise

RIDGE_MM, RIDGE_DEEP_MM = 0.48, 0.035
_RIDGE_PALER, _BESIDE_NAIL = 0.06, 0.3  # logarithms of pigment: of crests, and of the groove around the plate
_CELL_MM = (0.55, 0.85, 0.85), (1.3, 2.1, 2.1)  # along and across the digits
_CELL_DEEP_MM = (0.056, 0.030), (0.046, 0.045)  # of the young, and what age adds
_HALF_FURROW = 0.16, 0.10  # of a cell
_PAD_FROM_TIP_MM = 10.0
_RELIEF, _FOLDS, _PALM = 11, 12, 13  # purposes of random numbers
NAIL_EXPONENTS, BASE_NAIL_EXPONENTS = (2.3, 2.15), (3.6, 2.7)
"""Of a nail's outline across and along: of people who are drawn, and of the base."""
_MINOR_LINES = 120, 80  # of a palm: of the young, and what age adds


@dataclass(frozen=True)
class DrawnRelief:
    """Maps at the texels [T].

    Attributes:
        relief_mm: height of lines, ridges and rims.
        dorsal, palmar: depth of folds and creases, 1 at the deepest.
        furrow: how deep in the furrows between cells, 1 at the deepest.
        nail_rim: 1 on the outline of the nail, less inside, more beside.
        fine_pigment: logarithm of the pigment of what is finer than networks resolve, 0 in the mean of plain skin.
    """

    relief_mm: np.ndarray
    dorsal: np.ndarray
    palmar: np.ndarray
    furrow: np.ndarray
    nail_rim: np.ndarray
    fine_pigment: np.ndarray


class NailShape(NamedTuple):
    """[T] of a nail: `rim` as in `DrawnRelief`, and 1 on it, 0 beside."""

    rim: np.ndarray
    inside: np.ndarray


def nail_shape(chart: HandChart, exponents: tuple[float, float] = NAIL_EXPONENTS) -> NailShape:
    """Compute where nails are: with round corners, and rounder roots than ends."""
    across, along = np.abs(chart.nail_across), np.abs(chart.nail_along)
    a, b = exponents
    rim = (np.minimum(across, 4) ** a + np.minimum(along, 4) ** b) ** (2 / (a + b))
    on_back = chart.on_digit * smoothstep(chart.height, 0.3, 0.5)
    rim = np.where(on_back > 0, rim, 4).astype(np.float32)
    return NailShape(rim, on_back * smoothstep(rim, 1.0, 0.95))


def drawn_relief(chart: HandChart, look: PersonLook) -> DrawnRelief:
    """Draw the relief at the texels of a chart."""
    noise, nail = SolidNoise.of(look.random(_RELIEF)), nail_shape(chart)
    creases = palm_creases(look.random(_PALM), round(_MINOR_LINES[0] + _MINOR_LINES[1] * look.aged))
    skin = 1 - nail.inside
    rough = smoothstep(nail.rim, 1.05, 1.5)  # the folds of skin around a nail are smooth
    furrow_mm, furrow = (rough * part for part in _furrows(chart, noise, look))
    soft = 0.02 * noise.smooth(chart.points_mm, 2.6, 2)
    ridges_mm = _ridges(chart, noise, look)
    relief = skin * (soft - furrow_mm + ridges_mm) + _rim_mm(chart, nail)
    dorsal = rough * _dorsal_folds(chart, noise, look)
    speckles = 0.035 * noise.smooth(chart.points_mm[:, [1, 2, 0]], 1.0, 2)
    beside = bump(nail.rim - 1.005, 0.02) * smoothstep(chart.nail_along, 0.95, 0.7)
    pigment = skin * (speckles - 0.09 * furrow + _RIDGE_PALER * ridges_mm / RIDGE_DEEP_MM) - _BESIDE_NAIL * beside
    return DrawnRelief(relief, dorsal, _palmar_creases(chart, creases, noise, look), skin * furrow, nail.rim, pigment)


def leather(chart: HandChart, aged: float) -> np.ndarray:
    """Compute how deep [T] cells are by place: knuckles most, the back, least on the phalanges of the young."""
    joint = chart.from_joint_mm
    over_joints = bump(joint[:, 1], 6.0) + bump(joint[:, 2], 4.0) + 0.8 * bump(joint[:, 0], 8.0)
    of_digit = 0.42 + 0.3 * aged + 0.4 * over_joints.clip(0, 1)
    back = 0.85 + 0.15 * aged
    outer = chart.on_digit * of_digit + (1 - chart.on_digit) * back
    return (1 - chart.palm) ** 2 * outer * (1 - 0.45 * chart.arm)


def _furrows(chart: HandChart, noise: SolidNoise, look: PersonLook) -> tuple[np.ndarray, np.ndarray]:
    """Draw two nets of furrows, which wander, come and go: depth [T] mm, and 1 at the deepest."""
    depth = np.zeros(len(chart.palm), np.float32)
    deep = leather(chart, look.aged)
    at = (deep > 0.02).nonzero()[0]
    points = chart.points_mm[at]
    aside = np.stack([noise.smooth(points[:, order], 3.1, 1) for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))], 1)
    comes = noise.smooth(points[:, [2, 0, 1]], 7.0, 2)
    for size, half, (young, older), sign in zip(_CELL_MM, _HALF_FURROW, _CELL_DEEP_MM, (1, -1), strict=True):
        border = noise.cells(points + np.float32(0.22 * size[1]) * aside, size).border
        strength = smoothstep(sign * comes, -1.8, 0.9)
        depth[at] += (young + older * look.aged) * strength * smoothstep(border, half * 2, 0.0)
    depth *= deep
    return depth, (depth / 0.06).clip(0, 1)


def _ridges(chart: HandChart, noise: SolidNoise, look: PersonLook) -> np.ndarray:
    """Draw the ridges [T] mm of palm and fingers: arches and loops on the pads, bent by a wave of the person's own."""
    random, height = look.random(_RELIEF + 100), np.zeros(len(chart.palm), np.float32)
    at = (chart.palm > 0.35).nonzero()[0]
    points, digit = chart.points_mm[at], chart.digit[at]
    centre = np.array([random.uniform(20, 60), random.uniform(-60, -35)])
    offset = random.uniform(-2.5, 2.5, (5, 2))
    squeeze = random.uniform(0.7, 1.5, 5)[digit]
    along = chart.along[at] - (chart.length[digit] - _PAD_FROM_TIP_MM) - offset[digit, 0]
    on_pad = np.hypot(along, squeeze * (chart.lateral[at] - offset[digit, 1]))
    on_palm = np.linalg.norm(plane(points) - centre, axis=1)
    is_digit = chart.on_digit[at] > 0.5
    level = np.where(is_digit, on_pad, on_palm) + np.where(is_digit, 0.8, 3.5) * noise.smooth(points, 26.0, 2)
    share = smoothstep(noise.smooth(points[:, [1, 2, 0]], 14.0, 2), -1.2, 0.6)
    place = smoothstep(chart.palm[at], 0.4, 0.9) * (1 - chart.arm[at]) * smoothstep(-plane(points)[:, 0], 2.0, -6.0)
    on_tip = np.where(is_digit, smoothstep(along, -14.0, -4.0), 0)
    strength = place * (0.13 + 0.87 * on_tip) * (0.25 + 0.75 * share) * (1 - 0.4 * look.aged)
    height[at] = RIDGE_DEEP_MM * strength * np.sin(2 * np.pi * level / RIDGE_MM)
    return height


def _dorsal_folds(chart: HandChart, noise: SolidNoise, look: PersonLook) -> np.ndarray:
    """Draw oval whorls [T] over the dorsal third of PIP, DIP and the thumb's joint; faint lines over the knuckles."""
    random, total = look.random(_FOLDS), np.zeros(len(chart.palm), np.float32)
    bend = noise.smooth(chart.points_mm[:, [1, 0, 2]], 5.0, 2)
    breaks = smoothstep(noise.smooth(chart.points_mm[:, [2, 1, 0]], 3.5, 2), -1.3, 0.5)
    for digit in range(5):
        for order, strength in enumerate((0.2, 1.0, 0.6)):
            spacing, aspect, centre, ring = random.uniform((1.1, 0.12, -0.8, 0), (1.6, 0.24, 0.8, 1))
            if digit == THUMB:
                strength = (0.0, 0.25, 0.7)[order]
            at = ((chart.digit == digit) & (np.abs(chart.from_joint_mm[:, order]) < 11)).nonzero()[0]
            along = chart.from_joint_mm[at, order] - centre
            across = chart.lateral[at]
            oval = np.hypot(along, aspect * across) if order else along
            wander = oval + np.float32(0.17) * bend[at] + np.float32(ring)
            crown = np.abs(np.sin(np.pi * wander / np.float32(spacing)))
            line = (1 - crown) ** 2.2
            radial = (1 - np.abs(np.sin(3.2 * across + 1.3 * bend[at]))) ** 3 * bump(oval - 3.5, 1.6) * 0.35
            width = (4.6, 3.9, 2.7)[order] * (1.25 if digit == THUMB else 1.0)
            place = smoothstep(chart.height[at], 0.35, 0.8) * bump(along, width) * chart.on_digit[at].clip(0.4, 1)
            total[at] += strength * place * (line * (0.35 + 0.65 * breaks[at]) + radial)
    return total.clip(0, 1.2) * (0.8 + 0.2 * look.aged)


def _palmar_creases(chart: HandChart, lines: PlaneImage, noise: SolidNoise, look: PersonLook) -> np.ndarray:
    """Draw the creases [T]: of palm and wrist from their image, and across the digits where they fold."""
    random = look.random(_PALM + 100)
    down = smoothstep(chart.palm, 0.3, 0.6) * smoothstep(-chart.normals[:, 1], 0.0, 0.35)
    down = np.maximum(down, smoothstep(chart.arm, 0.0, 0.01) * smoothstep(-chart.normals[:, 1], 0.1, 0.5))
    total = (1 - chart.on_digit) * down * lines.at(chart.points_mm)
    below = smoothstep(-chart.height, 0.0, 0.65) * chart.on_digit
    comes = 0.62 + 0.38 * noise.smooth(chart.points_mm, 4.5, 2).clip(-1.2, 1)
    for digit in range(5):
        at = (chart.digit == digit).nonzero()[0]
        across = chart.lateral[at]
        joints = chart.joints_along[digit]
        root = 0.5 * joints[1] + 2.0
        rows = [(joints[2], 0.75), (joints[1] - 1.3, 0.9), (joints[1] + 1.5, 0.55), (root, 0.7), (root + 2.2, 0.35)]
        if digit == THUMB:
            rows = [(joints[2], 0.85), (joints[2] + 2.0, 0.3), (joints[1], 0.4)]
        for place, strength in rows:
            phase, tilt, bow = random.uniform(0, 6.28, 3), random.normal(0, 0.04), random.normal(0, 0.008)
            waves = 0.25 * np.sin(across / 2.1 + phase[0]) + 0.18 * np.sin(across / 0.9 + phase[1])
            off = chart.along[at] - (place + random.normal(0, 0.3) + tilt * across + bow * across**2 + waves)
            beside = random.choice([-1, 1]) * random.uniform((0.7, 1.5), (1.1, 2.2))
            finer = sum(share * bump(off - aside, 0.17) for share, aside in zip((0.4, 0.25), beside, strict=True))
            line = strength * comes[at] * (bump(off, 0.32) + finer)
            total[at] = np.maximum(total[at], below[at] * line)
    return total.clip(0, 1.2)


def _rim_mm(chart: HandChart, nail: NailShape) -> np.ndarray:
    """Draw the skin that lies on the plate's root and sides, ridges along the plate, and its end, mm."""
    rim, along = nail.rim, chart.nail_along
    root = smoothstep(along, 0.2, -0.5)
    fold = bump(rim - 1.1, 0.07) * (0.06 + 0.09 * root) * smoothstep(along, 0.9, 0.5)
    groove = 0.05 * bump(rim - 1.0, 0.025) * smoothstep(along, 0.95, 0.6)
    grain = 0.0015 * np.sin(14 * chart.nail_across + 0.7 * np.sin(5 * chart.nail_across)) * nail.inside
    return np.where(rim < 3, fold - groove, 0) + grain
