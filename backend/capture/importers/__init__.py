"""Importers: captures from the data sets and files of others."""
