"""Tasks on events, methods, and the study that compares resolutions."""

DISTRIBUTION = "eres-events"
"""Name of the distribution at the package index, where `eres` is another project."""
