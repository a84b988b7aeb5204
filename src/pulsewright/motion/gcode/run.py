"""Programs in, moves or canonical calls out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pulsewright.errors import GcodeError
from pulsewright.motion.gcode.faults import Fault
from pulsewright.motion.gcode.flow import Flow
from pulsewright.motion.gcode.interpreter import Interpreter
from pulsewright.motion.gcode.printer import Printer
from pulsewright.motion.gcode.recorder import Recorder
from pulsewright.motion.gcode.settings import InterpreterSettings
from pulsewright.motion.gcode.source import Source
from pulsewright.motion.moves import AXES, Moves, Program
from pulsewright.units import INCH

BULK_LINES = 500  #: lines from which on the compiled reader pays

#: What ``rs274 -g`` takes for a machine: one with inch parameters and six axes.
STAND_ALONE = InterpreterSettings(axes=AXES, unit=INCH)


def interpret(
    path: str | Path,
    *,
    settings: InterpreterSettings | None = None,
    take: Callable[[Moves], None] | None = None,
) -> Program:
    """Interpret a program file.

    Parameters
    ----------
    path : str or Path
    settings : InterpreterSettings, optional
    take : callable, optional
        Gets the moves of a long program while it is read, some thousands at a time; the result has
        those that are left, and all events. Less memory than all of them at once.

    Raises
    ------
    GcodeError
        If the file cannot be read, is not text, is empty, or asks for what cannot be done; with
        line and column where there are any.

    Examples
    --------
    >>> program = interpret("examples/rosette.ngc")
    >>> len(program.moves), program.moves.end[-1]
    """
    return _record(Source.from_file(path), settings or InterpreterSettings(), take)


def interpret_text(
    text: str, path: str | Path = "program", *, settings: InterpreterSettings | None = None
) -> Program:
    r"""Interpret a program given as text; ``path`` names it in errors and in the result.

    Raises
    ------
    GcodeError
        As `interpret`.

    Examples
    --------
    >>> interpret_text("G0 X10 \n G1 X20 F600").moves.feed
    array([inf, 10.])
    """
    return _record(Source(text.encode(), str(path)), settings or InterpreterSettings())


def canonical(
    path: str | Path,
    write: Callable[[str], object],
    *,
    settings: InterpreterSettings = STAND_ALONE,
) -> Interpreter:
    """Write the canonical calls of a program file in the form of ``rs274 -g``.

    Parameters
    ----------
    path : str or Path
        The program.
    write : callable
        Takes each line.
    settings : InterpreterSettings
        The machine; without, the one that ``rs274`` takes on its own.

    Returns
    -------
    Interpreter
        With the parameters and tools as the program leaves them.

    Raises
    ------
    GcodeError
        As `interpret`; the calls before it have been written.
    """
    interpreter = Interpreter(settings, Printer(write))
    Flow(interpreter, Source.from_file(path)).run()
    return interpreter


def _record(
    source: Source,
    settings: InterpreterSettings,
    take: Callable[[Moves], None] | None = None,
) -> Program:
    tolerances = settings.path_tolerance, settings.exact_tolerance
    recorder = Recorder(settings.start, *tolerances, take)
    interpreter = Interpreter(settings, recorder)
    bulk = None
    if source.count >= BULK_LINES:
        from pulsewright.motion.gcode.bulk import Bulk  # compiled code takes time to load

        bulk = Bulk(interpreter, recorder, source).run
    Flow(interpreter, source, bulk).run()
    try:
        return recorder.program(source.path)
    except Fault as fault:
        text = source.text(recorder.line - 1).strip()
        raise GcodeError(
            fault.message, path=source.path, line=recorder.line, column=1, text=text
        ) from None
