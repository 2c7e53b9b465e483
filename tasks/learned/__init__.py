"""Networks and their weights. Only this folder imports PyTorch, and only when a network is used."""
