"""Networks and their weights. Only this folder imports PyTorch, and only when a network is used."""

import os

# On small images PyTorch's threads wait for each other thousands of times. By default they spin for
# milliseconds before they free the core; if it has other work, an image takes up to 100 times as
# long. OpenMP reads this when PyTorch is imported.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", "1000")
