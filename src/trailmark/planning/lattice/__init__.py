"""Weighted A* over lattices of configurations: first paths, and others that may lead around better."""
