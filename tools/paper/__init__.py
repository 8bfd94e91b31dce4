"""Experiments on the paper's claims that the other tables do not settle; research alone, nothing of it ships."""
