"""A graph of poses: relations by odometry, scan matches and loop closures, optimised together."""
