"""Programs of the repository itself, which no user installs."""
