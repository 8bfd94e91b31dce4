"""Many frames on disk, by many processes: leases, frame files, progress, provenance, workers."""
