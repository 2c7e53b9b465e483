"""The command `eres`: the command line, until a signal ends it."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from types import FrameType
from typing import Any

# Ctrl-C; what SLURM, `timeout` and `docker stop` send; what a closed terminal sends.
_SIGNALS = "SIGINT", "SIGTERM", "SIGHUP"
_TOGETHER_S = 1.0  # signals of a terminal and its shell, or of a key pressed twice
_AGAIN_S = 0.01
_RESUMING = "render", "study", "dataset", "rig render", "train reconstruction", "train flow"


def main() -> None:
    """Run the command line.

    The exit code is 1 for an error, 2 for wrong usage, 128 + N if signal N ended the command: 130
    for Ctrl-C.
    """
    stopping = _Stopping()
    try:
        with stopping:
            from tasks.cli.command_line import run  # takes a second, in which signals may come

            run()
    except BaseException as error:  # whatever it became on its way
        if stopping.number is None and not isinstance(error, KeyboardInterrupt):
            raise
    else:
        return
    # Without the error, whose frames hold child processes.
    resumes = not {*sys.argv[1:2], " ".join(sys.argv[1:3])}.isdisjoint(_RESUMING)
    how = "; the same command continues after the completed parts" if resumes else ""
    with suppress(OSError):  # the terminal may be closed
        print(f"stopped{how}", file=sys.stderr, flush=True)
    sys.exit(128 + (stopping.number or signal.SIGINT))


class _Stopping:
    """A context in which the first signal raises KeyboardInterrupt, so that all is cleaned up.

    A later signal ends the process at once. Signals that were ignored at the start, as by `nohup`,
    stay ignored.
    """

    def __init__(self) -> None:
        self.number: int | None = None
        self._at_s = 0.0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> None:
        self._report, sys.unraisablehook = sys.unraisablehook, self._unraisable
        for name in _SIGNALS:
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._stop)

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        sys.unraisablehook = self._report

    def _stop(self, number: int, _: FrameType | None) -> None:
        if self.number is None:
            self.number, self._at_s = number, time.monotonic()
            raise KeyboardInterrupt
        if time.monotonic() - self._at_s > _TOGETHER_S:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

    def _unraisable(self, dropped: Any) -> None:
        """Send a signal again that came where Python drops exceptions.

        Such are finalizers, and what Numba's compiler calls from C.
        """
        if self.number is None or not isinstance(dropped.exc_value, KeyboardInterrupt):
            self._report(dropped)
            return
        number, self.number = self.number, None
        send: Callable[[int], None] = signal.raise_signal
        if hasattr(signal, "pthread_kill"):  # unlike the other, also ends a wait of this thread
            send = partial(signal.pthread_kill, threading.get_ident())
        threading.Timer(_AGAIN_S, send, [number]).start()
