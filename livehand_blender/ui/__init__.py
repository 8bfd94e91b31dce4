"""Operators, panels and menus."""
