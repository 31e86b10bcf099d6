"""A simulated robot: how it drives, what its sensors read, and the log of that."""
