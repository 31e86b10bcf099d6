"""Parts of the benchmark of worlds that change (benchmarks.change)."""
