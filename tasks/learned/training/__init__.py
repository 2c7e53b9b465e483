"""Train our own small networks on random crops. The loop is here; the crops need no PyTorch."""
