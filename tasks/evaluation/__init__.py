"""From sensors to scores: simulate events, run methods on them, and score the answers."""
