"""Exploration of an unknown world, from landmark to landmark, until it is proven that nothing more can be seen."""
