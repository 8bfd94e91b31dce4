"""One module per pose file format; each ends with its `FORMAT`."""
