"""Where independent tasks run: processes of this machine, or the workers of a Dask cluster.

A task that fails is reported, and the others go on.
"""

import asyncio
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, Generic, TypeVar
from urllib.parse import urlsplit

import cv2
from joblib import Parallel, delayed, parallel_config
from threadpoolctl import threadpool_limits

from link.errors import InputError

T = TypeVar("T")
R = TypeVar("R")

BACKENDS = ("loky", "dask")
"""Names that ``--backend`` takes: processes of this machine, or workers of a Dask cluster."""
CONNECT_S = 10
"""Seconds to wait for the scheduler, for its first worker, and for another once all are gone."""


@dataclass(frozen=True)
class Backend:
    """How many processes, and where."""

    jobs: int = 1
    """Processes of this machine; 1 stays in this one."""
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://host:8786, whose workers take the tasks."""


@dataclass(frozen=True)
class Failure:
    """An exception of one task, as text: exceptions of some packages cannot be sent."""

    reason: str
    """What went wrong, in one line."""
    trace: str = ""
    """Python's traceback; empty where there is none."""


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """What became of the task number ``index``: its result, or its failure."""

    index: int
    """Number of the task among those that were given."""
    result: R | None = None
    """What the task returned; None where it failed."""
    failure: Failure | None = None
    """Why the task failed; None where it did not."""


DIED = Failure("its process died, perhaps out of memory; the system's log may say more")
"""Failure of a task whose process ended without an exception."""


def make_backend(name: str, jobs: int, scheduler: str | None) -> Backend:
    """Make a backend of the flags ``--backend``, ``--jobs`` and ``--scheduler``.

    Raises:
        InputError: the flags clash.
    """
    if name not in BACKENDS:
        raise InputError(f"--backend: choose one of {', '.join(BACKENDS)}, got {name!r}")
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


def run_tasks(task: Callable[[T], R], items: Sequence[T], backend: Backend) -> Iterator[Outcome[R]]:
    """``task(item)`` for each item, in parallel, in the order in which they finish.

    Args:
        task: picklable, and so are items and results. An exception in it becomes a `Failure`, and
            so does the death of its process.
        items: one a task.
        backend: where they run.

    Raises:
        InputError: Dask is not installed, or no scheduler or worker answers.
    """
    attempt = partial(_attempt, task)
    if backend.scheduler is None:
        yield from _in_processes(attempt, items, backend.jobs)
    else:
        yield from _on_cluster(attempt, items, backend.scheduler)


def _attempt(task: Callable[[T], R], index: int, item: T) -> Outcome[R]:
    """Run one task; what it raises becomes a `Failure`."""
    try:
        return Outcome(index, result=task(item))
    except InputError as error:
        return Outcome(index, failure=Failure(str(error), traceback.format_exc()))
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Outcome(index, failure=Failure(reason, traceback.format_exc()))


def _in_processes(
    attempt: Callable[[int, T], Outcome[R]], items: Sequence[T], jobs: int
) -> Iterator[Outcome[R]]:
    """Run tasks in processes of this machine."""

    def finished(indices: Sequence[int], jobs: int) -> Iterator[Outcome[R]]:
        parallel = Parallel(
            n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch="all"
        )
        try:
            yield from parallel(delayed(attempt)(index, items[index]) for index in indices)
        except BrokenProcessPool:  # one process died, and all tasks under way are lost with it
            return

    threading.excepthook = _report_thread
    waiting = set(range(len(items)))
    with parallel_config("loky", inner_max_num_threads=1):
        for outcome in finished(range(len(items)), jobs):
            waiting.remove(outcome.index)
            yield outcome
        for index in sorted(waiting):  # each alone, in a process that is not this one
            yield next(finished([index], 2), Outcome(index, failure=DIED))


def _report_thread(failed: threading.ExceptHookArgs) -> None:
    """Print what ended a thread, except that loky's misses a task which an interrupt dropped."""
    name = failed.thread.name if failed.thread else ""
    if (failed.exc_type, name) != (KeyError, "ExecutorManagerThread"):
        threading.__excepthook__(failed)


def _on_cluster(
    attempt: Callable[[int, T], Outcome[R]], items: Sequence[T], scheduler: str
) -> Iterator[Outcome[R]]:
    """Run tasks on the workers of a Dask cluster."""
    with _connect(scheduler) as client:

        def finished(indices: Sequence[int]) -> Iterator[tuple[int, Outcome[R] | None]]:
            futures = {client.submit(attempt, i, items[i], pure=False): i for i in indices}
            return _finished_on_cluster(client, futures)

        lost: list[int] = []
        for index, outcome in finished(range(len(items))):
            if outcome is None:
                lost.append(index)
            else:
                yield outcome
        for index in sorted(lost):  # alone: others that waited on a worker that died are blamed too
            for _, outcome in finished([index]):
                yield outcome or Outcome(index, failure=DIED)


def _finished_on_cluster(
    client: Any, futures: dict[Any, int]
) -> Iterator[tuple[int, Outcome[R] | None]]:
    """Wait for tasks on a cluster; None in place of an outcome says that workers died of the task.

    Raises:
        InputError: the scheduler is gone, or no worker is left for `CONNECT_S` seconds.
    """
    distributed = import_module("distributed")
    while futures:
        try:
            with client.as_current():
                distributed.wait(list(futures), CONNECT_S, return_when="FIRST_COMPLETED")
            for future in [future for future in futures if future.done()]:
                try:
                    outcome = future.result(CONNECT_S)  # a task's own exception is in its outcome
                except distributed.KilledWorker:
                    outcome = None
                yield futures.pop(future), outcome
        except TimeoutError:  # tasks take their time, or a result is made again with its worker
            if not client.scheduler_info()["workers"]:
                raise InputError(
                    f"--scheduler: no worker is left for {CONNECT_S} s; start `dask worker` and "
                    "run the command again, which goes on where it stopped"
                ) from None
        except CancelledError as error:
            raise InputError(f"--scheduler: the connection is lost ({error})") from None


def _connect(scheduler: str) -> Any:
    """A `distributed.Client` with at least one worker."""
    try:
        distributed = import_module("distributed")
    except ModuleNotFoundError:
        raise InputError(
            "--backend dask: the package distributed is missing; pip install -e '.[dask]'"
        ) from None
    _check_address(scheduler)
    try:
        client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler: no Dask scheduler at {scheduler} ({error})") from None
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        client.close()
        raise InputError(
            f"--scheduler: {scheduler} has no worker after {CONNECT_S} s; start `dask worker`"
        ) from None
    return client


def _check_address(scheduler: str) -> None:
    """Raise an `InputError` at once where no scheduler listens; a client would try for long."""
    try:
        parts = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.scheme not in ("tcp", "tls") or parts.path not in ("", "/"):
        raise InputError(
            f"--scheduler: need an address such as tcp://host:8786, got {scheduler!r:.100}"
        )
    try:
        socket.create_connection((host, port), CONNECT_S).close()
        asyncio.run(_shake_hands(f"{parts.scheme}://{host}:{port}"))
    except (OSError, UnicodeError) as error:  # a name that no DNS takes is a UnicodeError
        reason = str(error) or "what listens there does not answer as one"
        raise InputError(f"--scheduler: no Dask scheduler at {scheduler} ({reason})") from None


async def _shake_hands(address: str) -> None:
    """Raise an `OSError` where something listens that is no Dask scheduler."""
    connect = import_module("distributed.comm").connect
    comm = await asyncio.wait_for(connect(address, timeout=CONNECT_S), CONNECT_S)
    await comm.close()
