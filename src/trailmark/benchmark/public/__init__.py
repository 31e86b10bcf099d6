"""Public benchmark sets, read from the folders in which they are published, and worlds of graded difficulty."""
