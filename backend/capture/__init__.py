"""Multi-view captures: the file format, its checks, importers, masks, and the plan of a synthetic capture."""
