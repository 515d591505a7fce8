"""Independent tasks whose results a study needs all: in parallel, and kept as they are made.

Every result is added to a file of JSON lines, so that a restarted command goes on where it was cut
off.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from link.errors import InputError
from link.files.lock import locked
from link.images import write_bytes
from link.outside import is_file
from reports.engine.backends import Backend, run_tasks
from reports.engine.checked import read_sealed, seal

T = TypeVar("T")


def resume(
    task: Callable[[T], Any], items: Mapping[str, T], file: Path, backend: Backend, title: str
) -> dict[str, Any]:
    """Run a task for each item whose result is not in a file yet, and add the new results to it.

    Args:
        task: function that is called with an item, and whose result JSON can hold.
        items: arguments of the task, by a name that tells them apart in the file.
        file: JSON lines, {"name": ..., "result": ..., "sha256": ...} each. Its path must say all
            that decides the results, apart from the items. A line whose digest does not fit is
            removed, and its result made again.
        backend: processes of this machine, or a Dask cluster.
        title: words before the progress bar.

    Returns:
        the results by name, in the order of the items.

    Raises:
        InputError: some tasks failed, and the results of the others are stored; or another process
            writes the folder.
    """
    with locked(file.parent):
        results = _read(file)
        missing = {name: item for name, item in items.items() if name not in results}
        names, failed, done = list(missing), [], len(items) - len(missing)
        with file.open("a", encoding="utf-8") as stream:
            for outcome in run_tasks(task, list(missing.values()), backend, title, done):
                name = names[outcome.index]
                if outcome.failure is not None:
                    failed.append(f"{name}: {outcome.failure.reason}")
                    continue
                line = seal({"name": name, "result": outcome.result})
                stream.write(line)
                stream.flush()
                results[name] = json.loads(line)["result"]
    if failed:
        raise InputError(f"{title}: {len(failed)} of {len(items)} failed: {'; '.join(failed)}")
    return {name: results[name] for name in items}


def _read(file: Path) -> dict[str, Any]:
    """Results by name; a line that was damaged, or cut off by a kill, is removed from the file."""
    lines = [
        line for line in read_sealed(file) if isinstance(line.get("name"), str) and "result" in line
    ]
    data = "".join(map(seal, lines)).encode()
    if is_file(file) and file.read_bytes() != data:
        write_bytes(file, data)
    return {line["name"]: line["result"] for line in lines}
