"""Traces as value change dumps, for GTKWave, Surfer and PulseView."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Final

from pulsewright.edges.trace import EdgeTrace
from pulsewright.errors import UsageError
from pulsewright.files import replacing

_UNITS: Final = ("s", "ms", "us", "ns", "ps", "fs")


def timescale(clock_hz: int) -> tuple[int, str, Fraction]:
    """Return the coarsest VCD time unit that holds a clock period exactly, and periods in it.

    A period that no unit holds (48 MHz: 20.83 ns) is counted in picoseconds, each change rounded
    for itself, so errors do not add up.

    Examples
    --------
    >>> timescale(40_000_000)
    (1, 'ns', Fraction(25, 1))
    """
    for exponent, unit in enumerate(_UNITS):
        for number in (100, 10, 1):
            periods = Fraction(1000**exponent, clock_hz * number)
            if periods.denominator == 1:
                return number, unit, periods
    return 1, "ps", Fraction(1000**4, clock_hz)


def write_vcd(
    path: Path | str, traces: EdgeTrace | Iterable[EdgeTrace], scope: str = "pulsewright"
) -> int:
    """Write a trace, or traces that follow each other, with one wire per pin.

    Time 0 of the file is cycle 0. Nothing but the trace at hand is held in memory.

    Returns
    -------
    int
        Number of level changes written.

    Raises
    ------
    UsageError
        If the traces do not follow each other, or the file cannot be written.
    """
    from vcd import VCDWriter

    chunks: Iterator[EdgeTrace] = iter([traces] if isinstance(traces, EdgeTrace) else traces)
    first = next(chunks, None)
    if first is None:
        raise UsageError(f"{path}: no trace to write")
    number, unit, periods = timescale(first.clock_hz)
    changes = 0
    with (
        replacing(path) as temporary,
        temporary.open("w", encoding="ascii") as file,
        VCDWriter(
            file, timescale=f"{number} {unit}", init_timestamp=round(first.start * periods)
        ) as writer,
    ):
        wires = [
            writer.register_var(scope, pin, "wire", size=1, init=int(level))
            for pin, level in zip(first.pins, first.initial, strict=True)
        ]
        before = first
        for chunk in chain([first], chunks):
            if chunk is not first:
                chunk.require_after(before)
            before = chunk
            cycles, pins, levels = (column.tolist() for column in chunk.events())
            for cycle, pin, level in zip(cycles, pins, levels, strict=True):
                writer.change(wires[pin], round(cycle * periods), level)
            changes += len(cycles)
        writer.close(round(before.end * periods))
    return changes
