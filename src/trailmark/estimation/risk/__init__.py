"""Obstacles grown so that a path meets none of the true ones with a stated probability."""
