"""Independent tasks whose results a study needs all: in parallel, and kept as they are made.

`each_result` runs tasks. `resume` also appends every result to a file of JSON lines, so that a
restarted command goes on where it was cut off.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from link.errors import InputError
from link.images import make_folder, write_bytes
from reports.engine.backends import Backend, run_tasks

T = TypeVar("T")
R = TypeVar("R")


def each_result(
    task: Callable[[T], R], items: Mapping[str, T], jobs: int, title: str, done: int = 0
) -> Iterator[tuple[str, R]]:
    """Run a task for each item, in parallel, under a progress bar.

    >>> dict(each_result(abs, {"one": -1, "two": -2}, jobs=1, title="count"))
    {'one': 1, 'two': 2}

    Args:
        task: function that is called with an item; picklable, as are items and results.
        items: arguments of the task by a name that tells them apart.
        jobs: number of processes on this machine; 1 stays in this one.
        title: words before the progress bar.
        done: number of items that were finished earlier, for the progress bar alone.

    Yields:
        the name of an item and its result, in the order in which tasks finish.

    Raises:
        InputError: some tasks failed; it is raised after the last result.
    """
    names, failed = list(items), []
    outcomes = run_tasks(task, list(items.values()), Backend(jobs))
    for outcome in tqdm(outcomes, total=done + len(names), initial=done, desc=title):
        if outcome.failure is not None:
            failed.append(f"{names[outcome.index]}: {outcome.failure.reason}")
        else:
            yield names[outcome.index], outcome.result
    if failed:
        total = done + len(names)
        raise InputError(f"{title}: {len(failed)} of {total} failed: {'; '.join(failed)}")


def all_results(task: Callable[[T], R], items: Sequence[T], jobs: int, title: str) -> list[R]:
    """Run a task for each item, in parallel, and return the results in the order of the items.

    >>> all_results(abs, [-1, -2], jobs=1, title="count")
    [1, 2]

    Args:
        task: function that is called with an item; picklable, as are items and results.
        items: arguments of the task.
        jobs: number of processes on this machine; 1 stays in this one.
        title: words before the progress bar.

    Raises:
        InputError: some tasks failed.
    """
    named = {str(number): item for number, item in enumerate(items)}
    found = dict(each_result(task, named, jobs, title))
    return [found[name] for name in named]


def resume(
    task: Callable[[T], Any], items: Mapping[str, T], file: Path, jobs: int, title: str
) -> dict[str, Any]:
    """Run a task for each item whose result is not in a file yet, and add the new results to it.

    Args:
        task: function that is called with an item, and whose result JSON can hold.
        items: arguments of the task, by a name that tells them apart in the file.
        file: JSON lines, {"name": ..., "result": ...} each. Its path must say all that decides the
            results, apart from the items: what is in it is taken as it is.
        jobs: number of processes on this machine; 1 stays in this one.
        title: words before the progress bar.

    Returns:
        the results by name, in the order of the items.

    Raises:
        InputError: some tasks failed; the results of the others are stored.
    """
    results = _read(file)
    missing = {name: item for name, item in items.items() if name not in results}
    make_folder(file.parent)
    with file.open("a", encoding="utf-8") as stream:
        finished = len(items) - len(missing)
        for name, result in each_result(task, missing, jobs, title, finished):
            line = json.dumps({"name": name, "result": result}, allow_nan=False)
            stream.write(f"{line}\n")
            stream.flush()
            results[name] = json.loads(line)["result"]
    return {name: results[name] for name in items}


def _read(file: Path) -> dict[str, Any]:
    """Results by name; a line that was cut off where a command was killed is removed."""
    if not file.is_file():
        return {}
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines.pop()
        write_bytes(file, "".join(lines).encode())
    stored = [json.loads(line) for line in lines]
    return {line["name"]: line["result"] for line in stored}
