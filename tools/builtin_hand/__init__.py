"""Generates the built-in hand and the files of its surface that ship.

All grow from a template without an arm, `hand_without_arm.npz`, which does not ship.
"""

from __future__ import annotations

from pathlib import Path

TEMPLATE = Path(__file__).with_name("hand_without_arm.npz")
"""A whole hand model in MANO's format: a right hand that ends in a stump."""
