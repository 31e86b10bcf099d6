"""EKF-SLAM over a log: which reading is of which feature, and when a feature counts."""
