"""Files of events: simulated, converted, described, with ground truth beside them."""
