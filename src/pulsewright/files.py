"""Files that appear whole or not at all, alone or together."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pulsewright.errors import UsageError
from pulsewright.interrupts import kept_back


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Give a temporary name beside ``path`` to write to; it becomes ``path`` when all went well.

    Leaving with an exception removes what was written and leaves an older ``path`` untouched.

    Raises
    ------
    UsageError
        If the folder does not exist or cannot be written.

    Examples
    --------
    >>> with replacing("report.json") as temporary:
    ...     temporary.write_text("{}")
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise UsageError(f"{target}: cannot be written ({error.strerror})") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp keeps others from reading
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def appearing(folder: Path | str) -> Iterator[Path]:
    """Give a temporary folder to write files to; they go to ``folder`` when all went well.

    They do so at once, and an interrupt waits for it: files of two jobs are never beside each
    other. ``folder`` is made if missing. Leaving with an exception removes what was written and
    what was made, and leaves older files untouched.

    Raises
    ------
    UsageError
        If the folder cannot be made or written.

    Examples
    --------
    >>> with appearing("out/rosette") as temporary:
    ...     (temporary / "report.json").write_text("{}")
    """
    target = Path(folder)
    try:
        above = [target, *target.parents]
        nearest = next(path for path in above if path.exists())
        if not nearest.is_dir():
            raise UsageError(f"{nearest}: is a file; give the name of a folder")
        made = above[: above.index(nearest)]
        target.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target, prefix="."))
    except OSError as error:
        raise UsageError(f"{target}: cannot be written ({error.strerror})") from error
    try:
        yield temporary
        with kept_back():
            made = []
            for file in sorted(temporary.iterdir()):
                file.replace(target / file.name)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):  # somebody else uses it by now
            for parent in made:
                parent.rmdir()
