"""Promise: however suddenly the light changes, the events in memory at once are bounded."""

import numpy as np
import pytest

from sensor import SensorModel, stream
from sensor.engine import bank, chunks, devices
from sensor.engine.chunks import Chunks
from sensor.engine.group import SensorGroup

STILL, FLICKERING = 30, 30


@pytest.mark.parametrize("cutoff_hz", [np.inf, 200.0])
@pytest.mark.parametrize("noise_hz", [0.0, 500.0])
def test_a_burst_is_simulated_in_pieces(monkeypatch, cutoff_hz, noise_hz):
    """Promise: after still frames, a scene that flickers is divided before its events are in
    memory; without a burst nothing is divided; and the events are the same as in one chunk."""
    still = np.random.default_rng(0).uniform(0.2, 1, (64, 64))
    frames = [still] * STILL + [still * (10 if k % 2 else 1) for k in range(FLICKERING)]
    t_s = np.arange(len(frames)) * 1e-3
    model = SensorModel(
        width=64, height=64, cutoff_hz=cutoff_hz, dark_level=1e-3, shot_noise_hz=noise_hz
    )
    fired: list[int] = []
    advance = SensorGroup.advance

    def counted(group, *arguments):
        yield from advance(group, *arguments)
        fired.append(group.fired)

    monkeypatch.setattr(SensorGroup, "advance", counted)
    whole = [column.copy() for part in stream(frames, t_s, model) for column in part.columns]
    assert len(fired) == 1 + -(-(len(frames) - 1 - bank._FIRST_FRAMES) // devices._CHUNK_FRAMES)
    limit = 4 * still.size * 11  # 11 events a pixel and frame: of four flickering frames
    monkeypatch.setattr(chunks, "_CHUNK_EVENTS", limit)
    in_one_chunk = max(fired)
    fired.clear()
    divided = [column.copy() for part in stream(frames, t_s, model) for column in part.columns]
    assert max(fired) <= 1.5 * limit
    if cutoff_hz == np.inf:
        assert in_one_chunk > 3 * limit
    for k in range(4):
        np.testing.assert_array_equal(
            np.concatenate(whole[k::4]), np.concatenate(divided[k::4]), strict=True
        )


def test_steady_events_make_equal_pieces(monkeypatch):
    """Promise: once the rate is known, a chunk is divided evenly, also if the filter, of which the
    frames say nothing, holds most events back; and dark or invalid light foretells nothing."""
    model = SensorModel(width=40, height=40, contrast_threshold=0.2, dark_level=0.0)
    monkeypatch.setattr(chunks, "_CHUNK_EVENTS", 3500)
    swinging = np.exp(0.2 * (np.arange(25) % 2))[:, None, None] * np.ones((25, 40, 40))
    found = Chunks(swinging[0], [[model]])
    assert found.frames(swinging[1:]) == 2  # 1600 events a frame
    found.learn(2, 1000)  # less than a third of the ideal events
    assert found.frames(swinging[3:]) == 5  # of 22 frames with 500 each: in four chunks
    found.learn(5, 40_000)
    assert found.frames(swinging[8:]) == 1
    for light in (0.0, np.nan, -1.0, np.inf):
        assert Chunks(swinging[0], [[model]]).frames(np.full((9, 40, 40), light)) >= 1
