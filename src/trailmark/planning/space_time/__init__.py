"""Planning among moving obstacles: paths that pass before or behind them, certified in space and time."""
