"""Files of events: simulate, convert and describe them, and add ground truth."""
