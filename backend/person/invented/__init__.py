"""Invented people as avatars: the commands that make and adjust them."""
