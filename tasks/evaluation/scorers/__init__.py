"""From a sensor's events to scores, one file a task."""
