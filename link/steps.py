"""Long work in steps, so that one who follows a stream can spread it over many frames.

Work is a generator. It yields after each step the units of work that the step took, and returns
what it found. What makes the steps sets the unit: where a display is searched for
(`receiver.locate`), it is about a millisecond of one core at 1280 x 720; where a message is
decoded, `link.code.rateless.GRAPH_WORK` says it.
"""

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

Steps = Generator[int, None, T]
"""Work that yields the units of each step and returns a result of type T."""


def run_to_end(steps: Steps[T]) -> T:
    """Take all steps at once, and return what was found.

    >>> def search() -> Steps[str]:
    ...     yield 5
    ...     return "found"
    >>> run_to_end(search())
    'found'
    """
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
