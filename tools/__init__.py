"""What made the files that ship, and look development: programs for maintainers, in no package."""
