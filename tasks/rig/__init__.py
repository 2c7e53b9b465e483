"""A camera on a motorized slider in front of a printed page: virtual, and real."""
