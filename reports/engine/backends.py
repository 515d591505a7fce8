"""Where independent tasks run: processes of this machine, or a Dask cluster.

Both go through joblib. A task that fails is reported, and the others go on.
"""

import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Generic, TypeVar

import cv2
from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError
from threadpoolctl import threadpool_limits

from link.errors import InputError

T = TypeVar("T")
R = TypeVar("R")

BACKENDS = ("loky", "dask")
CONNECT_S = 15
"""Seconds to wait for the scheduler, and for its first worker."""


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
    """One line."""
    trace: str = ""


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """What became of the task number ``index``."""

    index: int
    result: R | None = None
    failure: Failure | None = None


DIED = Failure("its process died, perhaps out of memory; the system's log may say more")


def make_backend(name: str, jobs: int, scheduler: str | None) -> Backend:
    """From the flags ``--backend``, ``--jobs``, ``--scheduler``; an `InputError` if they clash."""
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

    def attempt(index: int, item: T) -> Outcome[R]:
        try:
            return Outcome(index, result=task(item))
        except InputError as error:
            return Outcome(index, failure=Failure(str(error), traceback.format_exc()))
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            return Outcome(index, failure=Failure(reason, traceback.format_exc()))

    def finished(indices: Sequence[int], jobs: int | None) -> Iterator[Outcome[R]]:
        try:
            parallel = Parallel(
                n_jobs=jobs, return_as="generator_unordered", batch_size=1, pre_dispatch="all"
            )
            yield from parallel(delayed(attempt)(index, items[index]) for index in indices)
        except TerminatedWorkerError:  # of one task, but loky drops them all
            return

    waiting = set(range(len(items)))
    with _started(backend):
        for outcome in finished(range(len(items)), None):
            if isinstance(outcome, Outcome):
                waiting.remove(outcome.index)
                yield outcome
        for index in sorted(waiting):
            alone = [] if backend.scheduler else list(finished([index], 2))  # 1 would be this one
            yield alone[0] if alone else Outcome(index, failure=DIED)


@contextmanager
def _started(backend: Backend) -> Iterator[None]:
    """A context in which joblib uses the backend."""
    if backend.scheduler is None:
        with parallel_config("loky", n_jobs=backend.jobs, inner_max_num_threads=1):
            yield
        return
    with _connect(backend.scheduler) as client, parallel_config(_reporting(client)):
        yield


def _reporting(client: Any) -> Any:
    """joblib's Dask backend, mended for a task whose workers died, and for a single worker.

    It would wait for ever for the one, and stay in this process for the other.
    """
    base = import_module("joblib._dask").DaskDistributedBackend

    class Reporting(base):  # type: ignore[misc, valid-type]
        def effective_n_jobs(self, n_jobs: int) -> int:
            return max(2, int(super().effective_n_jobs(n_jobs)))

        def submit(self, func: Any, callback: Any = None) -> Any:
            future = super().submit(func, callback)
            future.add_done_callback(lambda done: done.exception() and callback(done.exception()))
            return future

        def retrieve_result_callback(self, out: Any) -> Any:
            lost = isinstance(out, BaseException)
            return [None] if lost else super().retrieve_result_callback(out)

    return Reporting(client=client)


def _connect(scheduler: str) -> Any:
    """A `distributed.Client` with at least one worker."""
    try:
        distributed = import_module("distributed")
    except ModuleNotFoundError:
        raise InputError(
            "--backend dask: the package distributed is missing; pip install -e '.[dask]'"
        ) from None
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
