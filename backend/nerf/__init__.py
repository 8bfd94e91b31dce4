"""The method in plain torch, one part a module: rays, sampler, field, volume rendering, super-resolution."""
