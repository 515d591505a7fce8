"""Processes of this machine that simulate and decode."""

from typing import Any

from joblib.externals.loky import get_reusable_executor

IDLE_S = 300
"""Seconds after which a process of this machine ends that got no further task."""
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
"""Variables of the environment of processes of this machine, before their first import."""


def reusable_processes(jobs: int) -> Any:
    """Open processes of this machine, or give those that an earlier call has opened.

    All that runs in processes takes them here. `joblib.Parallel` is not used beside this: both keep
    one executor in the same place, and joblib fails where it finds one that it has not opened.

    Args:
        jobs: number of processes.

    Returns:
        an executor of loky, which `concurrent.futures` describes.
    """
    return get_reusable_executor(jobs, timeout=IDLE_S, env=ONE_THREAD)
