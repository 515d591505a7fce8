"""Run independent tasks, in processes of this machine or on the workers of a Dask cluster.

A task that fails is reported, and the others go on.
"""

import asyncio
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

import cv2
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from data_gen.processes import reusable_processes
from link.errors import InputError

T = TypeVar("T")

CONNECT_S = 10
"""Seconds to wait for the scheduler, and for its first worker."""


@dataclass(frozen=True)
class Backend:
    """Number of processes, or a cluster, for tasks."""

    jobs: int = 1
    """Processes of this machine; 1 stays in this one."""
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://host:8786, whose workers take the tasks."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of the task number ``index``: its result, or the text of the error.

    Exceptions of some packages cannot be sent between processes.
    """

    index: int
    """Number of the task among those that were given."""
    result: Any = None
    """Return value of the task; None where it failed."""
    reason: str = ""
    """Error in one line; empty where there was none."""
    trace: str = ""
    """Python's traceback; empty where there is none."""


def make_backend(name: str, jobs: int, scheduler: str | None) -> Backend:
    """Make a backend of the flags ``--backend``, ``--jobs`` and ``--scheduler``.

    Raises:
        InputError: the flags clash.
    """
    if name == "dask" and scheduler is None:
        raise InputError(
            "--backend dask: give --scheduler, the address that `dask scheduler` prints"
        )
    if name != "dask" and scheduler is not None:
        raise InputError("--scheduler: needs --backend dask")
    return Backend(jobs, scheduler)


def one_thread() -> None:
    """Hold this process to one thread in OpenCV, BLAS, OpenMP and torch.

    Sums of floats depend on how threads split them, so every process splits them alike: not.
    """
    cv2.setNumThreads(1)
    threadpool_limits(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def run_tasks(
    task: Callable[[T], Any], items: Sequence[T], backend: Backend, title: str = "", done: int = 0
) -> Iterator[Outcome]:
    """``task(item)`` for each item, in parallel, in the order in which they finish.

    Each task runs with one thread. One that imports torch calls `one_thread` once more after that.

    Args:
        task: picklable, and so are items and results. An exception in it becomes the `Outcome`, and
            so does the death of its process.
        items: one a task.
        backend: where they run.
        title: words before a progress bar; empty for none.
        done: number of items that were finished earlier, for the progress bar alone.

    Raises:
        InputError: Dask is not installed, or no scheduler or worker answers.
    """
    total = done + len(items)
    with tqdm(total=total, initial=done, desc=title, disable=not (title and total)) as bar:
        for outcome in _outcomes(partial(_attempt, task), items, backend):
            yield outcome
            bar.update()


def _outcomes(
    attempt: Callable[[int, T], Outcome], items: Sequence[T], backend: Backend
) -> Iterator[Outcome]:
    """Run tasks in this process or in others, those that were lost with another one once more."""
    if backend.scheduler is None and backend.jobs == 1:
        yield from map(attempt, range(len(items)), items)
        return
    lost = []
    for index, future in _finished(attempt, items, range(len(items)), backend):
        if future.exception() is None:
            yield future.result()
        else:
            lost.append(index)
    for index in lost:  # each alone, since a process that dies takes others with it
        for _, future in _finished(attempt, items, [index], backend):
            error = future.exception()
            yield _failed(index, error) if error else future.result()


def _attempt(task: Callable[[T], Any], index: int, item: T) -> Outcome:
    """Run one task by one thread; what it raises becomes the outcome."""
    one_thread()
    try:
        return Outcome(index, result=task(item))
    except Exception as error:
        return _failed(index, error)


def _failed(index: int, error: BaseException) -> Outcome:
    """An exception as text; an `InputError` says all in its own line."""
    name = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    reason = " ".join(f"{name}{error}".split())
    return Outcome(index, None, reason, "".join(traceback.format_exception(error)))


def _finished(
    attempt: Callable[[int, T], Outcome],
    items: Sequence[T],
    indices: Sequence[int],
    backend: Backend,
) -> Iterator[tuple[int, Future[Outcome]]]:
    """Run tasks in other processes; each is given back when it is done.

    A future has an exception only where the task's process died, or could not be given the task:
    what the task itself raises is in its outcome.

    Raises:
        InputError: the connection to the scheduler is lost.
    """
    with _executor(backend) as executor:
        futures: dict[Future[Outcome], int] = {}
        for index in indices:
            try:
                future = executor.submit(attempt, index, items[index])
            except BrokenProcessPool as error:  # an earlier task's process has died already
                future = Future()
                future.set_exception(error)
            futures[future] = index
        for future in as_completed(list(futures)):
            if future.cancelled():
                raise InputError(
                    "--scheduler: the connection is lost; run the command again, which goes on "
                    "where it stopped"
                )
            yield futures.pop(future), future


@contextmanager
def _executor(backend: Backend) -> Iterator[Executor]:
    """Processes of this machine, which later calls use again, or the workers of a cluster."""
    if backend.scheduler is not None:
        with _connect(backend.scheduler) as client:
            yield client.get_executor(pure=False)
        return
    executor = reusable_processes(backend.jobs)
    try:
        yield executor
    except BaseException:
        report, threading.excepthook = threading.excepthook, lambda _: None
        executor.shutdown(kill_workers=True)  # its thread ends in a KeyError of tasks that waited
        threading.excepthook = report
        raise


def _connect(scheduler: str) -> Any:
    """A `distributed.Client` with at least one worker."""
    try:
        distributed = import_module("distributed")
    except ModuleNotFoundError:
        raise InputError(
            "--backend dask: the package distributed is missing; pip install -e '.[dask]'"
        ) from None
    try:
        asyncio.run(_shake_hands(scheduler))  # a client alone waits for ever on what is silent
        client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler: no Dask scheduler at {scheduler!r:.100}; need an address such as "
            f"tcp://host:8786 ({str(error) or 'what listens there does not answer as one'})"
        ) from None
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        client.close()
        raise InputError(
            f"--scheduler: {scheduler} has no worker after {CONNECT_S} s; start `dask worker`"
        ) from None
    return client


async def _shake_hands(address: str) -> None:
    """Raise an `OSError` where no scheduler answers, and a `ValueError` where none can be."""
    connect = import_module("distributed.comm").connect
    comm = await asyncio.wait_for(connect(address, timeout=CONNECT_S), CONNECT_S)
    await comm.close()
