"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pulsewright.errors import UsageError


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
