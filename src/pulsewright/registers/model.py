"""A board's register map as plain data: what a room's generated ``registers.py`` is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from pulsewright.errors import UsageError

Side = Literal["read", "write", "word"]


@dataclass(frozen=True)
class Choice:
    """A named value of a field or of a profile switch."""

    name: str
    value: int
    desc: str = ""


@dataclass(frozen=True)
class Field:
    """Bits of a register with one meaning.

    Parameters
    ----------
    name : str
        Lower case, as in the source: ``soft_latch``.
    lsb, width : int
        Lowest bit, and number of bits.
    reset : int or None
        Raw value after reset; None where it is not stored (a pin, a strobe).
    unit : str
        Of one count (before ``fracwidth``), or empty.
    desc : str
        Meaning, in words.
    signed : bool
        Two's complement.
    fracwidth : int
        Fraction bits of a fixed-point number; the raw value counts ``2**-fracwidth`` units.
    per, first : str and int
        Where not empty, every bit belongs to one ``per`` (axis, input), the lowest to ``first``.
    clear_on_read : bool
        Reading the register sets the field to 0.
    formula : str
        The quantity from the raw value; ``{name}`` stands for a profile switch.
    choices : tuple of Choice
        Named values; others are reserved unless the description says more.
    """

    name: str
    lsb: int
    width: int
    reset: int | None
    unit: str = ""
    desc: str = ""
    signed: bool = False
    fracwidth: int = 0
    per: str = ""
    first: int = 0
    clear_on_read: bool = False
    formula: str = ""
    choices: tuple[Choice, ...] = ()

    @property
    def msb(self) -> int:
        """Highest bit."""
        return self.lsb + self.width - 1

    @property
    def mask(self) -> int:
        """Bits of the field, in place."""
        return ((1 << self.width) - 1) << self.lsb

    @property
    def minimum(self) -> int:
        """Smallest raw value."""
        return -(1 << (self.width - 1)) if self.signed else 0

    @property
    def maximum(self) -> int:
        """Largest raw value."""
        return (1 << (self.width - self.signed)) - 1

    @property
    def bits(self) -> str:
        """Bit range as documents write it: ``7:4`` or ``5``."""
        return f"{self.msb}:{self.lsb}" if self.width > 1 else str(self.lsb)

    def label(self, bit: int) -> str:
        """Say what bit ``bit`` of the register is: ``soft_latch``, ``load axis 3``, ``rate[2]``."""
        if self.per:
            return f"{self.name} {self.per} {self.first + bit - self.lsb}"
        return self.name if self.width == 1 else f"{self.name}[{bit - self.lsb}]"


@dataclass(frozen=True)
class Register:
    """Fields at one address, or at several addresses that are used alike.

    Parameters
    ----------
    board, name, side : str
        Where it is: ``usc``, ``DIVISOR``, ``write``. A board's two sides are separate maps. Side
        ``word`` is for words of messages, whose addresses have no meaning.
    addresses : tuple of int
        First byte of each instance, of which there is one per axis or encoder.
    size : int
        Bytes, low byte first at rising addresses.
    title : str
        For tables; ``{n}`` stands for the number of the instance.
    fields : tuple of Field
        From the highest bit down.
    desc : str
        Meaning, in words.
    takes_effect : str
        When a write acts.
    aliases : tuple of int
        Further addresses of the same register; of all instances in order, if it has several.
    latched : str
        Not empty: reads give a holding register; the text says what loads it.
    assembly : str
        Not empty: all bytes go to the register of this name, shared by several addresses.
    commits : bool
        Writing the highest byte hands the assembled value over.
    min_version : int
        Present from this ident version on.
    follows : str
        Profile switch that the register reads as.
    present_with : tuple of str
        Not empty: the register is there if one of these profile switches is not 0.
    address_bytes : int
        Bytes at one address; where it is ``size``, addresses are register numbers.
    """

    board: str
    name: str
    side: Side
    addresses: tuple[int, ...]
    size: int
    title: str
    fields: tuple[Field, ...]
    desc: str = ""
    takes_effect: str = ""
    aliases: tuple[int, ...] = ()
    latched: str = ""
    assembly: str = ""
    commits: bool = False
    min_version: int = 0
    follows: str = ""
    present_with: tuple[str, ...] = ()
    address_bytes: int = 1

    @property
    def key(self) -> str:
        """Name within its map: ``R_IDENT``, ``W_TIMER``, ``WORD_DURATION``."""
        return f"{'WORD' if self.side == 'word' else self.side[0].upper()}_{self.name}"

    @property
    def alias_groups(self) -> tuple[tuple[int, ...], ...]:
        """``aliases`` in groups of one address per instance."""
        n = len(self.addresses)
        return tuple(self.aliases[i : i + n] for i in range(0, len(self.aliases), n))

    @property
    def reset(self) -> int | None:
        """Word after reset, or None where some field has none."""
        word = 0
        for field in self.fields:
            if field.reset is None:
                return None
            word |= field.reset << field.lsb & field.mask
        return word

    def field(self, name: str) -> Field:
        """Return the field ``name``.

        Raises
        ------
        UsageError
            If there is none; the message lists those there are.
        """
        for field in self.fields:
            if field.name == name:
                return field
        known = ", ".join(field.name for field in self.fields)
        raise UsageError(f"{self.board} {self.key} has no field '{name}'; its fields are {known}")

    def field_at(self, bit: int) -> Field | None:
        """Return the field that holds bit ``bit``, or None for an unused bit."""
        return next((field for field in self.fields if field.lsb <= bit <= field.msb), None)

    def label(self, instance: int | None = None, byte: int | None = None) -> str:
        """Name the register, one instance of it, or one byte of that, for tables."""
        numbers = f"0..{len(self.addresses) - 1}" if instance is None else str(instance)
        text = self.title.replace("{n}", numbers)
        if byte is None or self.size == self.address_bytes:
            return text
        if self.size > 3:
            return f"{text}, byte {byte}"
        which = "low" if byte == 0 else "high" if byte == self.size - 1 else "mid"
        return f"{text}, {which} byte"


@dataclass(frozen=True)
class Place:
    """What is at one address: ``register``, instance ``instance``, from byte ``byte`` on."""

    register: Register
    instance: int
    byte: int
    alias: bool = False

    @property
    def label(self) -> str:
        """The place in words."""
        text = self.register.label(self.instance, self.byte)
        if self.alias:
            text += " (alias)"
        if self.register.commits and self.byte == self.register.size - 1:
            text += " (commits)"
        return text


@dataclass(frozen=True)
class ProfileSwitch:
    """A choice where a document is silent or contradicts itself.

    Parameters
    ----------
    name : str
        Key in ``PROFILES``.
    meaning : str
        What it decides, in words.
    values : tuple of int
        One per profile, in the order of `RegisterMap.profiles`.
    minimum, maximum : int
        Allowed values, both ends included.
    unit : str
        Of the value, or empty.
    choices : tuple of Choice
        Names of the values, if they have names.
    """

    name: str
    meaning: str
    values: tuple[int, ...]
    minimum: int
    maximum: int
    unit: str = ""
    choices: tuple[Choice, ...] = ()

    def text(self, value: int) -> str:
        """Write a value as its documents do: by name, or with its unit."""
        for choice in self.choices:
            if choice.value == value:
                return choice.name
        number = f"0x{value:02X}" if self.unit == "hex" else str(value)
        return number if self.unit in ("", "hex") else f"{number} {self.unit}"

    @property
    def allowed(self) -> str:
        """The allowed values in words."""
        if self.choices:
            return ", ".join(f"{choice.name} ({choice.value})" for choice in self.choices)
        bare = ProfileSwitch(self.name, "", (), 0, 0, "hex" if self.unit == "hex" else "")
        return f"{bare.text(self.minimum)}..{bare.text(self.maximum)}"


@dataclass(frozen=True)
class Constant:
    """A number of the board that is no register: a clock rate, a fixed time.

    ``unit`` may be empty, or ``hex`` for a number best read in hexadecimal.
    """

    name: str
    value: int
    unit: str
    desc: str

    @property
    def text(self) -> str:
        """The value as code writes it."""
        return f"0x{self.value:02X}" if self.unit == "hex" else f"{self.value:_}"

    @property
    def comment(self) -> str:
        """The meaning with its unit, if it has one."""
        return f"{self.desc} [{self.unit}]" if self.unit not in ("", "hex") else self.desc


@dataclass(frozen=True)
class Argument:
    """A number in a message.

    Parameters
    ----------
    name : str
        Lower case, as in the source.
    size : int
        Bytes, low byte first.
    repeat : str
        Not empty: there are as many of it as the earlier argument of this name says.
    """

    name: str
    size: int
    repeat: str = ""

    @property
    def text(self) -> str:
        """The argument as documents write it: ``value u32``, ``words u40 x count``."""
        times = f" x {self.repeat}" if self.repeat else ""
        return f"{self.name} u{8 * self.size}{times}"


@dataclass(frozen=True)
class Code:
    """A number with a name: an interrupt, a command, an instruction.

    Parameters
    ----------
    name : str
        Upper case: ``ASG_DONE``.
    value : int
        The number.
    desc : str
        Meaning, in words.
    arguments, reply : tuple of Argument
        What goes with it in a message, and what with the answer to that, in order.
    """

    name: str
    value: int
    desc: str
    arguments: tuple[Argument, ...] = ()
    reply: tuple[Argument, ...] = ()


@dataclass(frozen=True)
class Table:
    """Codes of one kind, which are no register.

    Parameters
    ----------
    prefix : str
        Begins the names of the constants: ``INT`` in ``INT_ASG_DONE``.
    title : str
        For people.
    codes : tuple of Code
        By value.
    unit : str
        ``hex`` where values are best read in hexadecimal, ``bit`` where they are bit numbers.
    desc : str
        What they have in common, in words.
    """

    prefix: str
    title: str
    codes: tuple[Code, ...]
    unit: str = ""
    desc: str = ""

    def __getitem__(self, name: str) -> Code:
        """Return a code by its name.

        Raises
        ------
        UsageError
            If there is none; the message lists those there are.
        """
        for code in self.codes:
            if code.name == name:
                return code
        known = ", ".join(code.name for code in self.codes)
        raise UsageError(f"{self.title}: no '{name}'; there are {known}")

    def at(self, value: int) -> Code | None:
        """Return the code with a value, or None where that is unused."""
        return next((code for code in self.codes if code.value == value), None)

    def text(self, value: int) -> str:
        """Write a value as its documents do."""
        return f"0x{value:02X}" if self.unit == "hex" else str(value)


@dataclass(frozen=True)
class RegisterMap:
    """Everything that the register source of a board says.

    Parameters
    ----------
    board, title, desc : str
        Name of the room, name for people, and a text in paragraphs.
    registers : tuple of Register
        The read side and then the write side, by address.
    profiles : tuple of str
        Names of the profiles; the first is the default.
    switches : tuple of ProfileSwitch
        With a value for each profile.
    constants : tuple of Constant
        Clock rates and other fixed numbers.
    address_bits : int
        Bits of an address that select the register.
    tables : tuple of Table
        Interrupts, commands and other codes that are no registers.
    hex_addresses : bool
        Documents write the numbers of whole registers in hexadecimal.
    pictures : bool
        Every register and word has a bit-field picture, in a file of its own.
    words : tuple of Register
        Words that messages are made of.
    """

    board: str
    title: str
    desc: str
    registers: tuple[Register, ...]
    profiles: tuple[str, ...]
    switches: tuple[ProfileSwitch, ...]
    constants: tuple[Constant, ...]
    address_bits: int
    tables: tuple[Table, ...] = ()
    hex_addresses: bool = False
    pictures: bool = False
    words: tuple[Register, ...] = ()

    @property
    def numbered(self) -> bool:
        """Whether an address is the number of a whole register, and not of a byte."""
        return all(register.address_bytes == register.size > 1 for register in self.registers)

    @property
    def decimal(self) -> bool:
        """Whether addresses are written in decimal."""
        return self.numbered and not self.hex_addresses

    def table(self, prefix: str) -> Table:
        """Return the table whose constants begin with ``prefix``.

        Raises
        ------
        UsageError
            If there is none; the message lists those there are.
        """
        for table in self.tables:
            if table.prefix == prefix:
                return table
        known = ", ".join(table.prefix for table in self.tables) or "none"
        raise UsageError(f"{self.board} has no table '{prefix}'; it has {known}")

    @cached_property
    def _by_key(self) -> Mapping[str, Register]:
        return {register.key: register for register in self.registers}

    @cached_property
    def _places(self) -> Mapping[tuple[Side, int], Place]:
        places: dict[tuple[Side, int], Place] = {}
        for register in self.registers:
            starts = [(at, i, False) for i, at in enumerate(register.addresses)]
            n = len(register.addresses)
            starts += [(at, i % n, True) for i, at in enumerate(register.aliases)]
            for at, instance, alias in starts:
                for i in range(register.size // register.address_bytes):
                    byte = i * register.address_bytes
                    places[register.side, at + i] = Place(register, instance, byte, alias)
        return places

    def __getitem__(self, key: str) -> Register:
        """Return a register by its key, such as ``W_TIMER``.

        Raises
        ------
        UsageError
            If there is none; the message lists those there are.
        """
        try:
            return self._by_key[key]
        except KeyError:
            known = ", ".join(self._by_key)
            raise UsageError(f"{self.board} has no register '{key}'; it has {known}") from None

    def at(self, side: Side, address: int) -> Place | None:
        """Return what one side has at a register address, or None where nothing is."""
        return self._places.get((side, address))
