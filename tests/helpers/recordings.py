"""A recording of a camera that also takes frames: a texture that moves steadily, from a seed."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from moving_texture import texture_in_motion
from sensor import Events, SensorModel, simulate
from sensor.formats import write_events

SIZE = 96, 72
C = 0.2
STEP = 10  # simulated frames from one frame of the camera to the next


@dataclass(frozen=True)
class MadeRecording:
    """Files of a recording, and its ground truth."""

    events_file: Path
    frames: Path
    events: Events
    light: np.ndarray  # (T, H, W) of each simulated frame, white at 1
    t_us: np.ndarray  # of each simulated frame

    def write_frames(self, folder, *, exposure=0, shift_us=0, table=True):
        """Write the camera's frames, each exposed for `exposure` simulated frames."""
        folder.mkdir(exist_ok=True)
        lines = []
        for k in range(0, len(self.t_us) - exposure, STEP):
            seen = self.light[k : k + exposure + 1].mean(0)
            cv2.imwrite(str(folder / f"{k:03}.png"), np.round(65535 * seen).astype(np.uint16))
            start, end = (int(self.t_us[j]) + shift_us for j in (k, k + exposure))
            lines.append(f"{start},{end},{k:03}.png" if table else f"{start}")
        head = "t_us_start,t_us_end,file" if table else "# unit: us"
        name = "frames.csv" if table else "timestamps.txt"
        (folder / name).write_text("\n".join([head, *lines]) + "\n")
        return folder


def make_recording(folder, size=SIZE):
    """Simulate 60 ms of a texture that moves 12 px, and write its events and frames."""
    frames, t_s = texture_in_motion(5, 61, size[::-1], 1e-3, travel_px=12.0)
    light = frames / frames.max()
    width, height = size
    model = SensorModel(width=width, height=height, contrast_threshold=C, dark_level=1 / 64)
    fired = simulate(light, t_s, model)
    events = Events(*fired.columns, width, height)  # of a camera without a model
    path = folder / "recording.h5"
    write_events(path, events)
    made = MadeRecording(path, folder / "frames", events, light, np.round(1e6 * t_s).astype(int))
    made.write_frames(made.frames)
    return made
