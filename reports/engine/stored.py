"""Independent tasks: in parallel, and with results that are kept as they are made.

Every result is added to a file of JSON lines, so that a restarted command goes on where it was cut
off.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from link.files.lock import locked
from reports.engine.backends import Backend, Outcome, run_tasks
from reports.engine.checked import read_sealed, seal, write_sealed

T = TypeVar("T")


def resume(
    task: Callable[[T], Any], items: Mapping[str, T], file: Path, backend: Backend, title: str
) -> tuple[dict[str, Any], dict[str, Outcome]]:
    """Run a task for each item whose result is not in a file yet, and add the new results to it.

    Args:
        task: function that is called with an item, and whose result JSON can hold.
        items: arguments of the task, by a name that tells them apart in the file.
        file: JSON lines, {"name": ..., "result": ..., "sha256": ...} each. Its path, or the items'
            names, must say all that decides the results. A line whose digest does not fit is
            removed, and its result made again.
        backend: processes of this machine, or a Dask cluster.
        title: words before the progress bar.

    Returns:
        the results by name, in the order of the items, and what failed, by name.

    Raises:
        InputError: another process writes the folder, or the backend cannot be had.
    """
    failed = {}
    with locked(file.parent):
        results = _read(file)
        missing = {name: item for name, item in items.items() if name not in results}
        names, done = list(missing), len(items) - len(missing)
        with file.open("a", encoding="utf-8") as stream:
            for outcome in run_tasks(task, list(missing.values()), backend, title, done):
                name = names[outcome.index]
                if outcome.reason:
                    failed[name] = outcome
                    continue
                line = seal({"name": name, "result": outcome.result})
                stream.write(line)
                stream.flush()
                results[name] = json.loads(line)["result"]
    return {name: results[name] for name in items if name in results}, failed


def _read(file: Path) -> dict[str, Any]:
    """Results by name; a line that was damaged, or cut off by a kill, is removed from the file."""
    lines = [
        line for line in read_sealed(file) if isinstance(line.get("name"), str) and "result" in line
    ]
    write_sealed(file, lines)
    return {line["name"]: line["result"] for line in lines}
