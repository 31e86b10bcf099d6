"""Discs among the cells of a grid map: shortest paths by tangents of the cells' corners, and lower bounds from them."""
