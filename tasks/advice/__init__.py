"""Which width to choose: the lag law, the stored cases behind it, and what follows from both."""
