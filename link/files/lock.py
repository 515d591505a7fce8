"""A lock on what a command writes, so that no two processes write one folder at the same time.

The kernel holds the lock and drops it when the process ends, however it ends. The file that carries
the lock names the process for whoever is refused, and is removed at a normal end. A file that a
killed process left behind locks nothing. It tells the next process to remove the temporary files
that were not renamed any more.

Locks need the module fcntl, which POSIX systems such as Linux and macOS have. Where it is missing,
as on Windows, nothing is locked and nothing that a killed process left is removed.
"""

import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from link.errors import InputError
from link.images import MAX_NAME_BYTES, make_folder

try:
    import fcntl
except ModuleNotFoundError:
    fcntl = None  # type: ignore[assignment]

LOCK = ".lock"
"""Name of the file in a folder that carries the lock of the process that writes there."""
TEMPORARY = re.compile(r"\.(.+)\.(\d+)\.tmp(?:\.\w+)?")
"""Pattern of the names under which files are written before they are renamed."""
PATIENCE_S = 0.5
"""Seconds to wait for the name of the process that holds a lock, before it is refused unnamed."""
_held: dict[str, int] = {}
"""Locks of this process: the open file descriptor by the real path of the lock's file."""


@contextmanager
def locked(folder: Path, file: str = "") -> Iterator[None]:
    """Keep other processes from writing a folder, or one file in it, while the block runs.

    A process that holds the lock already may take it again; the outermost block releases it. A
    process that is forked meanwhile does not hold it. On a system without fcntl, such as Windows,
    the folder is made and the block runs without a lock.

    Args:
        folder: is made if it is not there.
        file: name of the file in it that is written; empty where the whole folder is.

    Raises:
        InputError: another process holds the lock, which the message names, or the folder cannot
            be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with locked(Path(folder)):
    ...         names = os.listdir(folder)
    ...     names, os.listdir(folder)
    (['.lock'], [])
    """
    make_folder(folder)
    if fcntl is None:
        yield
        return
    path = os.path.join(os.path.realpath(folder), _lock_name(file))
    if path in _held:
        yield
        return
    descriptor, was_left = _acquire(folder / file, path)
    _held[path] = descriptor
    try:
        if was_left:
            _remove_temporaries(folder, file)
        yield
    finally:
        if _held.pop(path, None) == descriptor:  # a forked process has dropped it
            _remove(path, descriptor)
            os.close(descriptor)


def _lock_name(file: str) -> str:
    """Name of the file that carries the lock on a file, or on a whole folder where it is empty."""
    if not file:
        return LOCK
    short = len(os.fsencode(file)) + len(".") + len(LOCK) <= MAX_NAME_BYTES
    return f".{file if short else file[:50]}{LOCK}"


def _acquire(target: Path, path: str) -> tuple[int, bool]:
    """Open and lock a lock's file, which then names this process.

    Returns:
        the open file, and whether a process that was killed has left it.
    """
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        except OSError as error:
            raise InputError(f"{target}: cannot be written ({error.strerror})") from None
        taken = False
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = _holder(descriptor)
                if holder or time.monotonic() > deadline:
                    raise InputError(
                        f"{target}: {holder or 'another process'} is writing it; wait until it "
                        "ends, or choose another name"
                    ) from None
                time.sleep(0.01)
                continue
            if not _is_at(path, descriptor):  # its last holder removed it after it was opened
                continue
            was_left = os.fstat(descriptor).st_size > 0
            name = f"{os.getpid()} {platform.node()}\n".encode()
            os.pwrite(descriptor, name, 0)  # never empty in between: it says what was left
            os.ftruncate(descriptor, len(name))
            taken = True
            return descriptor, was_left
        except OSError as error:
            raise InputError(f"{target}: cannot be locked ({error.strerror})") from None
        finally:
            if not taken:
                os.close(descriptor)


def _holder(descriptor: int) -> str:
    """The process that a lock's file names, in words; empty where it names none that lives."""
    said = os.pread(descriptor, 300, 0).decode(errors="replace").partition("\n")[0]
    process, _, host = said.partition(" ")
    if not process.isdecimal() or not host:
        return ""  # the holder has not written its name yet
    if host != platform.node():
        return f"process {process} on {host}"
    # a killed process left its name, and the holder has not written its own yet
    return f"process {process}" if _lives(int(process)) else ""


def _lives(process: int) -> bool:
    """Whether a process of this number runs, whoever it belongs to."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def _is_at(path: str, descriptor: int) -> bool:
    """Whether an open file is the one that has a name now."""
    try:
        there = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))


def _remove(path: str, descriptor: int) -> None:
    """Remove a lock's file that this process holds; where that fails, it stays and locks nothing.

    It is removed before the lock is dropped, so that nobody takes a file that is about to go.
    """
    try:
        if _is_at(path, descriptor):
            os.unlink(path)
    except OSError:
        pass


def _remove_temporaries(folder: Path, file: str) -> None:
    """Remove what a killed process wrote and could not rename, in a folder or beside a file."""
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            match = TEMPORARY.fullmatch(name)
            if match is None or (file and match[1] not in (file, file[:50])):
                continue  # `link.images.temporary_name` cuts long names
            if int(match[2]) != os.getpid() and _lives(int(match[2])):
                continue  # it is being written below a folder whose lock was free
            path = os.path.join(parent, name)
            if os.path.isdir(path) and not os.path.islink(path):
                shutil.rmtree(path, ignore_errors=True)
            else:
                os.unlink(path)
        if file:
            break


def _drop_in_child() -> None:
    """Close what a forked process has inherited, so that the lock ends with its parent."""
    for descriptor in _held.values():
        os.close(descriptor)
    _held.clear()


if fcntl is not None:
    os.register_at_fork(after_in_child=_drop_in_child)
