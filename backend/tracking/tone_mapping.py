"""High dynamic range video to sRGB: the inverse of its transfer function, its primaries, and a soft shoulder.

ITU-R BT.2100: hybrid log-gamma (HLG) and the perceptual quantiser (PQ), both on BT.2020 primaries. White at 203 cd/m^2
(BT.2408) becomes 1 before the shoulder.
"""

from __future__ import annotations

from functools import cache

import numpy as np

HLG, PQ = 18, 16
"""Numbers of the transfer functions (ITU-T H.273)."""

_HLG_A, _HLG_B, _HLG_C = 0.17883277, 0.28466892, 0.55991073
_HLG_SYSTEM_GAMMA, _HLG_PEAK_CD = 1.2, 1000.0
_PQ_M1, _PQ_M2, _PQ_C1, _PQ_C2, _PQ_C3, _PQ_PEAK_CD = 0.1593017578125, 78.84375, 0.8359375, 18.8515625, 18.6875, 10000.0
_WHITE_CD = 203.0
_LUMINANCE_2020 = np.array([0.2627, 0.6780, 0.0593], np.float32)
_TO_709 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]], np.float32)
_SHOULDER = 0.8  # of white; brighter light is compressed
_LEVELS = 1 << 12  # of the tables


def tone_mapped(encoded: np.ndarray, transfer: int) -> np.ndarray:
    """uint8 [H, W, 3] sRGB of a picture uint16 [H, W, 3] in HLG or PQ."""
    linear = _table(transfer)[encoded >> 4]
    if transfer == HLG:
        scene_luminance = linear @ _LUMINANCE_2020
        gain = np.maximum(scene_luminance, 1e-6) ** np.float32(_HLG_SYSTEM_GAMMA - 1)
        linear = linear * (gain * np.float32(_HLG_PEAK_CD / _WHITE_CD))[..., None]
    shown = _rolled_off(np.maximum(linear @ _TO_709.T, 0))
    return _srgb_table()[(shown * (_LEVELS - 1) + 0.5).astype(np.int32)]


def _rolled_off(linear: np.ndarray) -> np.ndarray:
    """As is up to the shoulder, then towards 1."""
    over = np.maximum(linear - _SHOULDER, 0) / (1 - _SHOULDER)
    return np.where(linear <= _SHOULDER, linear, _SHOULDER + (1 - _SHOULDER) * over / (1 + over)).astype(np.float32)


@cache
def _table(transfer: int) -> np.ndarray:
    """[4096] linear light of 12 bits: HLG's scene light in 0..1, PQ's in units of white."""
    encoded = np.arange(_LEVELS) / (_LEVELS - 1)
    if transfer == HLG:
        high = (np.exp((encoded - _HLG_C) / _HLG_A) + _HLG_B) / 12
        return np.where(encoded <= 0.5, encoded**2 / 3, high).astype(np.float32)
    power = encoded ** (1 / _PQ_M2)
    linear = (np.maximum(power - _PQ_C1, 0) / (_PQ_C2 - _PQ_C3 * power)) ** (1 / _PQ_M1)
    return (linear * _PQ_PEAK_CD / _WHITE_CD).astype(np.float32)


@cache
def _srgb_table() -> np.ndarray:
    linear = np.arange(_LEVELS) / (_LEVELS - 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (encoded * 255).round().astype(np.uint8)
