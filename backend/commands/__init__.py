"""Command-line commands that use several packages of the backend."""
