"""A process that ends with the one that started it, however that one ends.

A lock on a folder is that of the process that took it. Where that process is killed, the lock goes,
and what it started must not write into the folder any more.
"""

import multiprocessing
import os
import threading
from functools import cache


@cache
def end_with_parent() -> None:
    """End this process as soon as the one that started it by `multiprocessing` is gone.

    A thread waits for that. In a process that was not started by `multiprocessing`, nothing
    happens.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os._exit(1)  # nothing is cleaned up, and no file gets its final name

    threading.Thread(target=wait, name="parent", daemon=True).start()
