"""The native peer: OMPL and FCL in C++."""
