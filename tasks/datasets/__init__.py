"""Windows of events with their frames and ground truth, for training networks."""

from tasks.datasets.event_dataset import EventDataset

__all__ = ["EventDataset"]
