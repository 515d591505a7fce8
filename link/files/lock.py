"""A lock on what a command writes, so that no two processes write one folder at the same time.

The lock is filelock's: the kernel holds it and drops it when the process ends, however it ends. The
file that carries the lock is removed at a normal end. One that a killed process left behind locks
nothing. It tells the next process to remove the temporary files that were not renamed any more.
"""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from link.errors import InputError
from link.images import MAX_NAME_BYTES, make_folder

LOCK = ".lock"
"""Name of the file in a folder that carries the lock of the process that writes there."""
TEMPORARY = re.compile(r"\.(.+)\.(\d+)\.tmp(?:\.\w+)?")
"""Pattern of the names under which files are written before they are renamed."""


@contextmanager
def locked(folder: Path, file: str = "") -> Iterator[None]:
    """Keep other processes from writing a folder, or one file in it, while the block runs.

    A process that holds the lock already may take it again; the outermost block releases it. A
    process that is forked meanwhile does not hold it.

    Args:
        folder: is made if it is not there.
        file: name of the file in it that is written; empty where the whole folder is.

    Raises:
        InputError: another process holds the lock, or the folder cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with locked(Path(folder)):
    ...         names = os.listdir(folder)
    ...     names, os.listdir(folder)
    (['.lock'], [])
    """
    make_folder(folder)
    path = Path(os.path.realpath(folder), _lock_name(file))
    was_left = os.name == "posix" and path.exists()  # elsewhere no process can be asked if it lives
    lock = FileLock(path, blocking=False, thread_local=False, is_singleton=True)
    try:
        lock.acquire()
    except Timeout:
        raise InputError(
            f"{folder / file}: another process is writing it; wait until it ends, or choose "
            "another name"
        ) from None
    except OSError as error:
        raise InputError(f"{folder / file}: cannot be written ({error.strerror})") from None
    try:
        if was_left and lock.lock_counter == 1:
            _remove_temporaries(folder, file)
        yield
    finally:
        if lock.lock_counter == 1:  # 0 in a process that was forked within the block
            with suppress(OSError):  # while the lock is held, so that nobody takes a file that goes
                path.unlink()
        lock.release()


def _lock_name(file: str) -> str:
    """Name of the file that carries the lock on a file, or on a whole folder where it is empty."""
    if not file:
        return LOCK
    short = len(os.fsencode(file)) + len(".") + len(LOCK) <= MAX_NAME_BYTES
    return f".{file if short else file[:50]}{LOCK}"


def _is_running(process: int) -> bool:
    """Whether a process of this number runs, whoever it belongs to."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _remove_temporaries(folder: Path, file: str) -> None:
    """Remove what a killed process wrote and could not rename, in a folder or beside a file."""
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            match = TEMPORARY.fullmatch(name)
            if match is None or (file and match[1] not in (file, file[:50])):
                continue  # `link.images.temporary_name` cuts long names
            if int(match[2]) != os.getpid() and _is_running(int(match[2])):
                continue  # it is being written below a folder whose lock was free
            path = os.path.join(parent, name)
            if os.path.isdir(path) and not os.path.islink(path):
                shutil.rmtree(path, ignore_errors=True)
            else:
                os.unlink(path)
        if file:
            break
