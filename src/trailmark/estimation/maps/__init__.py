"""From a log to a world: settings, obstacles from detections and from scans, and figures on both."""
