"""Invented people: skin that is drawn on the built-in hand from a person's numbers and a seed."""
