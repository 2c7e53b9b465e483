"""What the events are good for: tasks, methods, and the study that compares resolutions."""
