"""Hand frames from one thread to another that may be slower: the newest waits."""

from collections.abc import Iterator
from threading import Condition
from typing import Generic, TypeVar

T = TypeVar("T")


class Newest(Generic[T]):
    """Holds one item for a reader in another thread, the newest that was put.

    >>> waiting = Newest[int]()
    >>> for item in (1, 2, 3):
    ...     waiting.put(item)
    >>> waiting.close()
    >>> list(waiting), waiting.passed_over
    ([3], 2)
    """

    def __init__(self) -> None:
        self.passed_over = 0
        """Number of items that newer ones have replaced before they were taken."""
        self._items: list[T] = []
        self._closed = False
        self._changed = Condition()

    @property
    def waits(self) -> bool:
        """Whether an item waits to be taken."""
        return bool(self._items)

    def put(self, item: T) -> None:
        """Put an item in place of the one that waits."""
        with self._changed:
            self.passed_over += len(self._items)
            self._items = [item]
            self._changed.notify()

    def close(self) -> None:
        """Say that nothing more comes; the item that waits is still taken."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def __iter__(self) -> Iterator[T]:
        """Take items as they come, until it is closed and none waits."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._items or self._closed)
                if not self._items:
                    return
                item = self._items.pop()
            yield item
