"""What a recording shows about its sensor: thresholds, noise, delay; each with an interval."""
