"""From a sensor's events to scores, one file for each task."""
