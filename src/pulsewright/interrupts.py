"""Ctrl-C and SIGTERM, kept back while a machine moves: nothing is torn in the middle of a word."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

KEPT: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def kept_back() -> Iterator[Callable[[], bool]]:
    """Keep Ctrl-C and SIGTERM back during a ``with`` block, and deliver them at its end.

    Yields a function that tells whether one has come. The first one then does what it would have
    done at once; SIGTERM, where it would have ended the program without any clean-up, raises
    `SystemExit` instead. Ignored signals stay ignored. In other threads than the main one, which
    get no signals, nothing is kept back.

    Examples
    --------
    >>> import os, signal
    >>> try:
    ...     with kept_back() as interrupted:
    ...         os.kill(os.getpid(), signal.SIGINT)
    ...         print(interrupted())
    ... except KeyboardInterrupt:
    ...     print("now")
    True
    now
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    came: list[tuple[int, Any]] = []
    handlers = {number: signal.getsignal(number) for number in KEPT}
    # a handler of None was not set from Python and could not be set again
    kept = [n for n, handler in handlers.items() if handler not in (signal.SIG_IGN, None)]
    for number in kept:
        signal.signal(number, lambda number, frame: came.append((number, frame)))
    try:
        yield lambda: bool(came)
    finally:
        for number in kept:
            signal.signal(number, handlers[number])
        if came:
            first, frame = came[0]
            handler = handlers[signal.Signals(first)]
            if callable(handler):
                handler(first, frame)
            else:
                raise SystemExit(128 + first)
