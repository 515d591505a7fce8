"""A time limit for native work, which Python itself cannot interrupt."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic

GRACE_S = 3.0
"""Seconds that work may go on after it was asked to stop, before the process ends."""


@dataclass
class _Work:
    """Native work in progress."""

    stop: Callable[[], None]
    deadline: float
    what: str
    stopped: bool = False


class Watchdog:
    """Stops native work that takes longer than it may.

    Work is first asked to stop. What does not heed that within `GRACE_S` cannot be ended alone, so
    the process ends with one line on stderr and exit status 2; otherwise it would hang for ever.

    One timer serves all work: it runs from the first piece to that piece's deadline, and only there
    looks whether anything is overdue. A piece of work that ends in time costs a lock and a clock.

    >>> with Watchdog().limit(5.0, lambda: None, "a sum"):
    ...     sum(range(10))
    45
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._works: dict[int, _Work] = {}
        self._timer: threading.Timer | None = None
        self._wakes_at = 0.0

    @contextmanager
    def limit(self, seconds: float, stop: Callable[[], None], what: str) -> Iterator[None]:
        """Watch what is done inside a ``with`` statement.

        Args:
            seconds: time that it may take.
            stop: asks it to stop; called from another thread.
            what: names the work in the line that is printed where it does not stop.
        """
        work = _Work(stop, monotonic() + seconds, what)
        with self._lock:
            self._works[id(work)] = work
            self._wake_by(work.deadline)
        try:
            yield
        finally:
            with self._lock:
                del self._works[id(work)]

    def _wake_by(self, deadline: float) -> None:
        """Have a timer that runs out at a deadline or before; a forked process has none."""
        if self._timer is not None and self._timer.is_alive() and self._wakes_at <= deadline:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._wakes_at = deadline
        self._timer = threading.Timer(max(0.0, deadline - monotonic()), self._look)
        self._timer.daemon = True
        self._timer.start()

    def _look(self) -> None:
        """Stop what is overdue, and look again at the next deadline, if there is one."""
        with self._lock:
            now = monotonic()
            for work in self._works.values():
                if work.deadline > now:
                    continue
                if work.stopped:
                    said = f"error: {work.what} takes too long and cannot be stopped"
                    os.write(2, f"{said}; the process ends\n".encode())
                    os._exit(2)
                work.stop()
                work.stopped, work.deadline = True, now + GRACE_S
            self._timer = None
            if self._works:
                self._wake_by(min(work.deadline for work in self._works.values()))
