"""Signals that wait while a C library which calls our code is at work.

Python runs handlers of signals between its own instructions, also within a function that a C
library calls. An exception there, such as KeyboardInterrupt, ends a call of the library's own, and
HDF5 then crashes or goes on as if nothing had happened.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class HeldSignals:
    """Signals with a handler in Python, held in a context of `held_signals`."""

    def __init__(self) -> None:
        self._holding = False
        self._handlers: dict[int, Any] = {}
        self._arrived: list[tuple[int, FrameType | None]] = []

    def _hold(self) -> None:
        if threading.current_thread() is threading.main_thread():  # no other one runs handlers
            for number in signal.valid_signals():
                if callable(handler := signal.getsignal(number)):
                    self._handlers[number] = handler
                    signal.signal(number, self._receive)
        self._holding = True

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self._holding:
            self._arrived.append((number, frame))
        else:
            self._handlers[number](number, frame)

    def _let_in(self) -> None:
        self._holding = False
        while self._arrived:
            number, frame = self._arrived.pop(0)
            self._handlers[number](number, frame)

    def _release(self) -> None:
        try:
            self._let_in()
        finally:
            for number, handler in self._handlers.items():
                signal.signal(number, handler)

    @contextmanager
    def let_in(self) -> Iterator[None]:
        """Handle the signals that arrived, and those that arrive within the context."""
        try:
            self._let_in()
            yield
        finally:
            self._holding = True


@contextmanager
def held_signals() -> Iterator[HeldSignals]:
    """Hold signals in a context; they are handled at its end, or where they are let in."""
    held = HeldSignals()
    try:
        held._hold()
        yield held
    finally:
        held._release()
