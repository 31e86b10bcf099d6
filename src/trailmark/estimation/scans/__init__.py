"""Laser scans: the lines and discs in them, followed from scan to scan."""
