"""A hand in a pose and a light as Gaussian splats, for other engines (Kerbl et al. 2023)."""
