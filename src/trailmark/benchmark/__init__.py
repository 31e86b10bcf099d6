"""The benchmark: the same problems, checker, seeds and objective for every planner; each run in a process of its own."""
