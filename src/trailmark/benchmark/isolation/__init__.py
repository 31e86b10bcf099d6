"""A process of its own for each run: a warm process forks a child for it, limits it, and ends it if it hangs.

``executors`` hands jobs to ``worker``s, each of which keeps a ``zygote`` process; that forks a ``child`` for each run.
"""
