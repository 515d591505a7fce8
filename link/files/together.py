"""Files that belong together get their names together, once all of them are written."""

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from link.errors import InputError
from link.images import make_folder, temporary_name


@contextmanager
def lent_folder(beside: Path, shown: Path) -> Iterator[Path]:
    """Lend an empty temporary folder beside a file or folder; it is removed when the block ends.

    Args:
        beside: what is written there at first; the temporary folder is named after it.
        shown: what errors name in place of the temporary folder.

    Raises:
        InputError: the folder or a file in it cannot be written.
    """
    temporary = temporary_name(beside)
    make_folder(temporary.parent)
    try:
        temporary.mkdir(exist_ok=True)
        yield temporary
    except OSError as error:
        raise InputError(f"{shown}: cannot be written ({error.strerror})") from None
    except InputError as error:
        if str(temporary) not in str(error):
            raise
        raise InputError(str(error).replace(str(temporary), str(shown))) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def written_together(folder: Path, last: str, others: Iterable[Path] = ()) -> Iterator[Path]:
    """Lend a temporary folder within a folder, whose files are moved up when the block ends.

    Where the block fails, none of its files is left. Where the process is killed, they stay in the
    temporary folder. The next process removes it that takes the lock (`link.files.lock.locked`) on
    the folder or on the file ``last``.

    Args:
        folder: where the files belong; made if it is not there.
        last: name of the file in it whose presence says that the others are whole; it is moved
            after them.
        others: what has the name that one of the others may get, and is there already.

    Raises:
        InputError: the folder or a file in it cannot be written, or something has its name, be it
            a folder or a symbolic link; the message names it by the place where it belongs.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with written_together(Path(folder), "list.txt") as temporary:
    ...         _ = (temporary / "list.txt").write_text("whole")
    ...     os.listdir(folder)
    ['list.txt']
    """
    for path in filter(os.path.lexists, (folder / last, *others)):
        raise InputError(f"{path} is there already; choose another name")
    with lent_folder(folder / last, folder) as temporary:
        yield temporary
        names = sorted(os.listdir(temporary), key=lambda name: (name == last, name))
        for name in names:
            (temporary / name).replace(folder / name)
