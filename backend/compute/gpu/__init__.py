"""Stages of a frame in NVIDIA Warp: on a GPU, and for tests on the CPU; nothing else imports this folder at once."""
