"""Batch estimation by gtsam: poses and features of a log with detections; poses of scans, with loop closures."""
