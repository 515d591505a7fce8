"""Files that belong together get their names together, once all of them are written."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from link.errors import InputError
from link.images import make_folder, temporary_name


@contextmanager
def written_together(folder: Path, last: str) -> Iterator[Path]:
    """Lend a temporary folder within a folder, whose files are moved up when the block ends.

    Where the block fails, none of its files is left. Where the process is killed, they stay in the
    temporary folder. The next process removes it that takes the lock (`link.files.lock.locked`) on
    the folder or on the file ``last``.

    Args:
        folder: where the files belong; made if it is not there.
        last: name of the file in it whose presence says that the others are whole; it is moved
            after them.

    Raises:
        InputError: the folder or a file in it cannot be written; the message names the file by
            the place where it belongs.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with written_together(Path(folder), "list.txt") as temporary:
    ...         _ = (temporary / "list.txt").write_text("whole")
    ...     os.listdir(folder)
    ['list.txt']
    """
    temporary = temporary_name(folder / last)
    make_folder(temporary)
    try:
        yield temporary
        names = sorted(os.listdir(temporary), key=lambda name: (name == last, name))
        for name in names:
            (temporary / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    except InputError as error:
        if str(temporary) not in str(error):
            raise
        raise InputError(str(error).replace(str(temporary), str(folder))) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
