"""The benchmark: same problems, checker, seeds and objective for every planner, each run in a process of its own."""
