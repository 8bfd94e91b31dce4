"""The radiance field about the posed mesh: rays, shell sampler, encodings, fields and compositing."""
