"""Event cameras: a catalogue with a source for each value, and the files that describe others."""
