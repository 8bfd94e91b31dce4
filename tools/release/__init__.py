"""The zips of a release, with wheels for each system and Python, and the repository that lists them."""
