"""Which port of a board is at which pin of an FPGA board.

A map gives each pad, bit by bit, a pin: ``{"step": ("pmod_1:1", "pmod_1:3")}``. Bits beyond the
end and those with None are at no pin: outputs lead nowhere, inputs read what an open pin reads,
which is 1 by the pull-up, or 0 for those that are active high.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from amaranth import Value
from amaranth.lib.wiring import Component, Flow

from pulsewright.errors import UsageError

PinMap = dict[str, tuple[str | None, ...]]

# The host's bus, EPP, serial or SPI: without it a board is of no use.
BUS: Final = (
    *("data", "nwrite", "ndatastr", "naddrstr", "nwait"),
    *("avr_tx", "avr_rx"),
    *("cs", "sck", "copi", "cipo"),
)
# Where the serial bus is on platforms with a serial port at their USB; nothing else may go there.
SERIAL: Final = {"avr_tx": "uart_0:rx", "avr_rx": "uart_0:tx"}
# Inputs that stop the machine when their wire breaks, so they need a wire.
SAFETY: Final = ("estop_chain",)
# Inputs that must not read 1 while they are open: no pull-up.
ACTIVE_HIGH: Final = (*SAFETY, "intr_i")
# One pin per axis; the first two that a board has make it move.
AXIS: Final = ("step", "dir", "a", "b", "index", "en", "mot_step", "mot_dir", "mot_enable")
# Such pins of boards that drive the windings themselves, instead of `AXIS`; step and direction come
# after all else.
BRIDGE: Final = ("phase_a1", "phase_a2", "phase_b1", "phase_b2", "en")
# Inputs of encoders where there may be more or fewer of them than axes; they take pins in pairs.
PAIRED: Final = ("enc_a", "enc_b")
# At pins only if a map says so: the reset of the host, what links several boards, and the direction
# of a level shifter for the data.
UNUSED: Final = (
    *("nreset", "ninit", "nconfig", "intr_i", "intr_o", "data_oe"),
    *("rst_n", "cclk"),
)
_GAP: Final = "-"


@dataclass(frozen=True)
class Pad:
    """Pins of one name.

    Parameters
    ----------
    name : str
    width : int
        Number of pins.
    direction : str
        ``i``, ``o`` or ``io``.
    high_z : bool
        Not driven while the component's ``tristate`` is 1.
    enabled : bool
        An output that is driven while the component's output ``<name>_oe`` is 1.
    """

    name: str
    width: int
    direction: Literal["i", "o", "io"]
    high_z: bool = False
    enabled: bool = False


def pads(component: Component) -> dict[str, Pad]:
    """Return the pads that the ports of a component make.

    ``x_i``, ``x_o`` and ``x_oe`` make the bidirectional pad ``x``, and ``x_oe`` one of its own;
    ``x`` and ``x_oe`` make an output ``x`` that is let go of. A ``tristate`` output makes no pad:
    it lets go of all outputs that do not belong to the bus.
    """
    ports = {
        str(path[0]): (len(Value.cast(value)), member.flow)
        for path, member, value in component.signature.flatten(component)
    }
    found: dict[str, Pad] = {}
    for name, (width, flow) in ports.items():
        stem, _, suffix = name.rpartition("_")
        if suffix in ("i", "o") and f"{stem}_oe" in ports:
            found.setdefault(stem, Pad(stem, width, "io"))
        elif flow is Flow.In:
            found[name] = Pad(name, width, "i")
        elif name != "tristate" and not (suffix == "oe" and stem in ports):
            high_z = "tristate" in ports and name not in (*BUS, *UNUSED)
            found[name] = Pad(name, width, "o", high_z, f"{name}_oe" in ports)
    return found


def required(pads: Mapping[str, Pad]) -> tuple[str, ...]:
    """Return the names of pads of which every bit must be at a pin."""
    return tuple(name for name in (*BUS, *SAFETY) if name in pads)


def axis_pads(pads: Mapping[str, Pad]) -> tuple[str, ...]:
    """Return the names of pads that have a pin per axis."""
    if BRIDGE[0] in pads:
        return BRIDGE
    return tuple(name for name in AXIS if name in pads)


def default_map(
    pads: Mapping[str, Pad], pins: Sequence[str], axes: int | None, where: str
) -> PinMap:
    """Return a map that fills the pins in order: bus, axis after axis, then all else.

    Parameters
    ----------
    pads : mapping of str to Pad
    pins : sequence of str
        Free pins.
    axes : int or None
        Axes to bring out; None: as many as there are pins for.
    where : str
        The platform, for messages.

    Raises
    ------
    UsageError
        If there are not that many axes, or pins for them.
    """
    wired = {name: pin for name, pin in SERIAL.items() if name in pads and pin in pins}
    pins = [pin for pin in pins if pin not in SERIAL.values()]
    bus = [
        (name, bit)
        for name in required(pads)
        if name not in wired
        for bit in range(pads[name].width)
    ]
    mine = axis_pads(pads)
    most = min((pads[name].width for name in mine), default=0)
    room = min(most, (len(pins) - len(bus)) // max(len(mine), 1))
    if axes is not None and not 1 <= axes <= most:
        raise UsageError(f"{axes} axes asked; the board has 1 to {most}")
    if axes is None:
        axes = max(room, 1)
    if axes > room:
        raise UsageError(
            f"{where} has {len(pins)} free pins; the bus takes {len(bus)} and each axis "
            f"{len(mine)} ({', '.join(mine)}), so at most {max(room, 0)} axes fit, not {axes}. Ask "
            f"for fewer axes, choose another platform, or say in a pin file which pads to leave out"
        )
    order = bus + [(name, axis) for axis in range(axes) for name in mine]
    rest = [name for name in pads if name not in (*BUS, *SAFETY, *mine, *UNUSED)]
    outputs_first = sorted(rest, key=lambda name: pads[name].direction == "i")
    order += [
        (name, bit)
        for name in outputs_first
        if name not in (*PAIRED, *AXIS)
        for bit in range(pads[name].width)
    ]
    pairs = [name for name in outputs_first if name in PAIRED]
    order += [(name, bit) for bit in range(pads[pairs[0]].width) for name in pairs] if pairs else []
    order += [(name, axis) for axis in range(axes) for name in rest if name in AXIS]
    found: dict[str, list[str | None]] = {name: [pin] for name, pin in wired.items()}
    for (name, _), pin in zip(order, pins, strict=False):
        found.setdefault(name, []).append(pin)
    return {name: tuple(found[name]) for name in pads if name in found}


def load(path: Path, pads: Mapping[str, Pad], pins: Sequence[str], where: str) -> PinMap:
    """Read a map from a TOML file.

    The file has a line for each pad: ``step = ["pmod_1:1", "-", "pmod_1:3"]``, ``"-"`` for a bit
    without a pin, or one string for a pad of one bit. It is the whole map: pads that are not in it
    are at no pin.

    Raises
    ------
    UsageError
        If the file cannot be read, names a pad or pin that is not there or a pin twice, or leaves
        out a pad that must be there; the message says which and what is allowed.
    """
    try:
        with path.open("rb") as file:
            entries = tomllib.load(file)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not a TOML file ({error})") from error

    taken: dict[str, str] = {}
    found: PinMap = {}
    for name, entry in entries.items():
        if name not in pads:
            raise UsageError(f"{path}: the board has no pad '{name}'; it has {', '.join(pads)}")
        words = [entry] if isinstance(entry, str) else entry
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            raise UsageError(
                f'{path}: {name} must be a pin or a list of pins, such as ["{pins[0]}"]; "-" '
                f"stands for a bit without a pin"
            )
        if len(words) > pads[name].width:
            raise UsageError(
                f"{path}: {name} is given {len(words)} pins; it has {pads[name].width} bits"
            )
        for bit, pin in enumerate(words):
            label = span(pads[name], [bit])
            if pin == _GAP:
                continue
            if pin not in pins:
                raise UsageError(
                    f"{path}: {where} has no free pin '{pin}' for {label}; it has {ranges(pins)}"
                )
            if pin in taken:
                raise UsageError(f"{path}: pin {pin} is given to {taken[pin]} and to {label}")
            taken[pin] = label
        found[name] = tuple(None if word == _GAP else word for word in words)

    for name in required(pads):
        placed = [pin for pin in found.get(name, ()) if pin]
        if len(placed) < pads[name].width:
            raise UsageError(
                f"{path}: {name} needs {pads[name].width} pins and has {len(placed)}; always "
                f"needed are {', '.join(required(pads))}"
            )
    if not axes_of(found, pads):
        raise UsageError(f"{path}: no axis has its {' and '.join(axis_pads(pads)[:2])} at pins")
    return found


def axes_of(pin_map: PinMap, pads: Mapping[str, Pad]) -> tuple[int, ...]:
    """Return the axes whose step and dir, or the first winding, are at pins."""
    step, direction = (pin_map.get(name, ()) for name in axis_pads(pads)[:2])
    return tuple(n for n, pair in enumerate(zip(step, direction, strict=False)) if all(pair))


def rows(pin_map: PinMap, pads: Mapping[str, Pad]) -> list[tuple[str, str, tuple[str, ...]]]:
    """Return (bits, direction, pins) of each pad that is at pins: ``data[0..7]``, ``io``."""
    found: list[tuple[str, str, tuple[str, ...]]] = []
    for name, places in pin_map.items():
        bits = [bit for bit, pin in enumerate(places) if pin]
        if bits:
            pins = tuple(pin for pin in places if pin)
            found.append((span(pads[name], bits), pads[name].direction, pins))
    return found


def left_out(pin_map: PinMap, pads: Mapping[str, Pad]) -> list[str]:
    """Return the bits that are at no pin: ``nreset``, ``dout[4..13]``."""
    missing = []
    for name, pad in pads.items():
        places = pin_map.get(name, ())
        absent = [bit for bit in range(pad.width) if bit >= len(places) or not places[bit]]
        if absent:
            missing.append(span(pad, absent))
    return missing


def span(pad: Pad, bits: Sequence[int]) -> str:
    """Return bits of a pad as one writes them: ``led``, ``step[2]``, ``dout[4..13]``."""
    if pad.width == 1:
        return pad.name
    if len(bits) > 1 and bits[-1] - bits[0] == len(bits) - 1:
        return f"{pad.name}[{bits[0]}..{bits[-1]}]"
    return f"{pad.name}[{' '.join(map(str, bits))}]"


def toml(pin_map: PinMap, note: str) -> str:
    """Return a map as a file that `load` reads."""
    lines = [f"# {note}", '# Pads that are not here are at no pin; "-" leaves out one bit.']
    for name, places in pin_map.items():
        words = ", ".join(f'"{pin or _GAP}"' for pin in places)
        lines.append(f"{name} = [{words}]")
    return "\n".join(lines) + "\n"


def ranges(pins: Sequence[str]) -> str:
    """Return pins by connector: ``pmod_0:1 2 3 4, pmod_1:1 2``."""
    groups: dict[str, list[str]] = {}
    for pin in pins:
        connector, _, name = pin.rpartition(":")
        groups.setdefault(connector, []).append(name)
    return ", ".join(f"{connector}:{' '.join(names)}" for connector, names in groups.items())
