"""Canonical commands of a program, with its parameter file and tool table."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pulsewright.motion.gcode import canonical
from pulsewright.motion.gcode.parameters import KEPT, read_parameters, write_parameters
from pulsewright.motion.gcode.run import STAND_ALONE
from pulsewright.motion.gcode.tools import read_tools, write_tools


def print_canonical(
    file: str | Path,
    *,
    machine: str | Path | None = None,
    tools: str | Path | None = None,
    parameters: str | Path | None = None,
    subroutines: Sequence[str] = (),
    block_delete: bool = False,
    save: bool = False,
) -> None:
    """Print the canonical commands of a program in the form of ``rs274 -g``.

    Parameters
    ----------
    file : str or Path
        The program.
    machine : str or Path, optional
        Machine file; without, the machine that ``rs274`` takes on its own, whose parameters and
        tools are in inches.
    tools, parameters : str or Path, optional
        Tool table and parameter file.
    subroutines : sequence of str
        Folders with files of subroutines.
    block_delete : bool
        Skip lines that begin with ``/``.
    save : bool
        Write parameters and tools back as the program leaves them.

    Raises
    ------
    UsageError
        If a file cannot be used; `GcodeError` at the first line that cannot be done.
    """
    settings = STAND_ALONE
    if machine is not None:
        from pulsewright.app.planning import interpreter_settings
        from pulsewright.motion.machine import Machine

        settings = interpreter_settings(Machine.load(machine))
    settings = replace(
        settings,
        subroutines=tuple(subroutines),
        block_delete=block_delete or settings.block_delete,
    )
    if tools is not None:
        settings = replace(settings, tools=read_tools(tools, settings.unit))
    values: dict[int, float] = {}
    if parameters is not None:
        values = read_parameters(parameters)
        settings = replace(settings, parameters=values)
    interpreter = canonical(file, sys.stdout.write, settings=settings)
    if save and parameters is not None:
        numbered = interpreter.parameters.numbered
        write_parameters(parameters, {n: numbered[n] for n in KEPT | set(values)})
    if save and tools is not None and interpreter.tools is not None:
        write_tools(tools, interpreter.tools, settings.unit)
