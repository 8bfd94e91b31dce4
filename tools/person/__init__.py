"""Measures of persons made from pictures of real hands, which only a checkout has."""
