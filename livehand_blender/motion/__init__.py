"""Motions between files and a hand's keyframes."""
