"""Frames that are taken before they are wanted: order, limits, and errors."""

import threading
from contextlib import closing

import pytest

from eres_render.sequence.sequence import read_ahead
from tasks.evaluation.evaluate import FRAMES_AHEAD


class Frames:
    """Numbers in place of frames; notes which were taken, and by which threads."""

    def __init__(self, count, bad=None):
        self.count, self.bad = count, bad
        self.taken, self.threads = 0, set()
        self.enough = threading.Event()

    def __iter__(self):
        for k in range(self.count):
            if k == self.bad:
                raise ValueError(f"frame {k}")
            self.taken += 1
            self.threads.add(threading.current_thread())
            if self.taken == FRAMES_AHEAD + 1:
                self.enough.set()
            yield k


def frames_ahead(frames, count):
    source = iter(frames)
    return closing(read_ahead(lambda k: next(source), range(count), threads=1, most=FRAMES_AHEAD))


@pytest.mark.parametrize("count", [0, 1, FRAMES_AHEAD, 5 * FRAMES_AHEAD])
def test_frames_come_in_order_from_one_other_thread(count):
    """Promise: each frame once, in order; one thread takes them all, as a renderer needs."""
    frames = Frames(count)
    with frames_ahead(frames, count) as ahead:
        assert list(ahead) == list(range(count))
    assert len(frames.threads) == min(count, 1)
    assert threading.current_thread() not in frames.threads


def test_no_more_frames_are_held_than_said():
    """Promise: while one frame is in use, at most `FRAMES_AHEAD` are taken, in all; none after."""
    frames = Frames(100)
    with frames_ahead(frames, 100) as ahead:
        assert [next(ahead), next(ahead)] == [0, 1]
        assert frames.enough.wait(60)
    assert frames.taken == FRAMES_AHEAD + 1


def test_an_error_comes_with_its_frame():
    """Promise: the frames before it arrive; a failed consumer ends the thread too."""
    with frames_ahead(Frames(10, bad=3), 10) as ahead:
        assert [next(ahead) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(ValueError, match="frame 3"):
            next(ahead)
    frames = Frames(100)

    def stop_at_the_first():
        with frames_ahead(frames, 100) as ahead:
            raise KeyError(next(ahead))

    with pytest.raises(KeyError):
        stop_at_the_first()
    assert not any(thread.is_alive() for thread in frames.threads)
