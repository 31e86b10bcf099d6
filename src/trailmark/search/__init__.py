"""Searches over graphs that are made on the way: lattices, a car's drives, tangents in grid maps; and their heap."""
