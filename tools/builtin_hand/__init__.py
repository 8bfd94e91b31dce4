"""Generates the built-in hand and the files of its surface that ship."""
