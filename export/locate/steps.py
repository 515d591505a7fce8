"""A search in steps, so that one who follows a stream can spread it over many frames.

A search is a generator. It yields after each step the units of work that the step took, and returns
what it found. A unit is about a millisecond of one core at 1280 x 720.
"""

from collections.abc import Generator
from typing import TypeVar

T = TypeVar("T")

Steps = Generator[int, None, T]
"""A search that yields units of work and returns a result of type T."""


def run_to_end(steps: Steps[T]) -> T:
    """Take all steps of a search at once, and return what it found.

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
