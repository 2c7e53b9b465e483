"""What the events are good for: tasks, methods, and the study that compares resolutions."""

DISTRIBUTION = "eres-events"
"""What is installed, by its name at the package index, where `eres` is another project."""
