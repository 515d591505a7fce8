"""Run a command in a process forked from one that has all modules loaded; needs Linux.

Tests that run a command hundreds of times in processes of their own need not import it each time.
"""

import contextlib
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from link.cli import run_cli


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int
    """Exit status, or minus the number of the signal that ended it."""
    seconds: float
    """Time from its start to its end."""
    cpu_s: float
    """Processor time that it took, in seconds."""
    peak_bytes: int
    """Largest memory that it had."""
    stdout: str
    stderr: str


def run_forked(
    main: Callable[[], None],
    words: list[str],
    work: Path,
    logs: Path,
    kill_s: float,
    prepare: Callable[[], object] = lambda: None,
) -> Ended:
    """Run ``main`` with a command line in the folder ``work``, and kill it after ``kill_s``.

    It runs in a process group of its own, which is killed as a whole. What it prints is left in
    the files stdout and stderr of ``logs``. ``prepare`` is called in its process before it starts.
    """
    printed = [logs / "stdout", logs / "stderr"]
    for file in printed:
        file.touch()
    start = time.monotonic()
    child = os.fork()
    if not child:
        _run_in_child(main, words, work, printed, prepare)
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - start >= kill_s:
            with contextlib.suppress(ProcessLookupError):  # it has no group of its own yet
                os.killpg(child, signal.SIGKILL)
            os.kill(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            break
        time.sleep(0.001)
    _kill_group(child)
    seconds = time.monotonic() - start
    cpu_s = usage.ru_utime + usage.ru_stime
    said = [file.read_text("utf-8", errors="replace") for file in printed]
    code = os.waitstatus_to_exitcode(status)
    return Ended(code, seconds, cpu_s, usage.ru_maxrss * 1024, *said)


def _run_in_child(
    main: Callable[[], None],
    words: list[str],
    work: Path,
    printed: list[Path],
    prepare: Callable[[], object],
) -> None:
    status = 99
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for descriptor, file in enumerate(printed, 1):
            os.dup2(os.open(file, os.O_WRONLY | os.O_TRUNC), descriptor)
        os.chdir(work)
        sys.argv = words
        prepare()
        run_cli(main)
        status = 0
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 1
        if isinstance(ended.code, str):
            print(ended.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _kill_group(group: int) -> None:
    """Kill what is left of a process group, and wait until it is gone."""
    for _ in range(500):
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            return
        except PermissionError:  # nothing but processes that have ended
            return
        time.sleep(0.01)
