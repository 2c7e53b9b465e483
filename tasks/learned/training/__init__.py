"""Train our own small networks on random crops."""
