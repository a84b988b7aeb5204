"""Write side of a register map, made from the map itself."""

from __future__ import annotations

from collections.abc import Iterable

from amaranth import Cat, Module, Signal, Value
from amaranth.lib import data
from amaranth.lib.wiring import Component, In, Member, Out

from pulsewright.registers.model import Register, RegisterMap


def layout(register: Register) -> data.FlexibleLayout:
    """Return the fields of a register as an Amaranth layout of its whole word."""
    return data.FlexibleLayout(
        8 * register.size,
        {field.name: data.Field(field.width, field.lsb) for field in register.fields},
    )


class WriteBank(Component):
    """Bytes in, registers out.

    The highest byte of a register commits it: all its fields change at that clock edge. The bytes
    below wait in one latch, which all registers share and which nothing clears: a lone high byte
    commits with the low bytes of an earlier write. A register that names an assembly register in
    the map has that one as its latch, which takes the highest byte too. Only bits that belong to a
    field are kept.

    Parameters
    ----------
    register_map : RegisterMap
    present : iterable of str, optional
        Names of the registers to make; default: all of the write side.
    aliases : bool
        Further addresses of a register act as its first ones; otherwise nothing is there.
    stray_addresses : range
        Addresses here feed byte 0 of the latch although no register is there.

    Members
    -------
    write : In(1)
        Write ``data`` to ``address`` at this clock edge.
    address : In(address_bits), data : In(8)
    word : Out(8 * size)
        What a register of the largest size takes if it commits at this edge.
    <register> : Out(layout), or an array of them
        One for each register, in lower case, such as ``velocity[2].value``; an array where the map
        has several instances.
    <register>_commit : Out(instances)
        High in the cycle that ends with the edge that commits.

    Raises
    ------
    ValueError
        If ``present`` names a register that the map does not have.
    """

    def __init__(
        self,
        register_map: RegisterMap,
        *,
        present: Iterable[str] | None = None,
        aliases: bool = True,
        stray_addresses: range = range(0),
    ) -> None:
        written = {r.name: r for r in register_map.registers if r.side == "write"}
        names = list(written if present is None else present)
        if unknown := [name for name in names if name not in written]:
            raise ValueError(
                f"{register_map.board} has no write register {', '.join(unknown)}; it has "
                f"{', '.join(written)}"
            )
        self._registers = {name: written[name] for name in names}
        self._latch = next((r.assembly for r in self._registers.values() if r.assembly), "")
        self._size = max(register.size for register in self._registers.values())
        # What is where: (register, instance, byte) by address.
        self._places: dict[int, tuple[str, int, int]] = {}
        for address in range(1 << register_map.address_bits):
            place = register_map.at("write", address)
            if place and place.register.name in self._registers and (aliases or not place.alias):
                self._places[address] = place.register.name, place.instance, place.byte
        self._stray = [address for address in stray_addresses if address not in self._places]
        members: dict[str, Member] = {
            "write": In(1),
            "address": In(register_map.address_bits),
            "data": In(8),
            "word": Out(8 * self._size),
        }
        for name, register in self._registers.items():
            instances = len(register.addresses)
            word = Out(layout(register), init={f.name: f.reset or 0 for f in register.fields})
            members[name.lower()] = word if instances == 1 else word.array(instances)
            members[f"{name.lower()}_commit"] = Out(instances)
        super().__init__(members)

    def elaborate(self, platform: object) -> Module:
        m = Module()
        latch = Signal(8 * self._size)

        def written(addresses: Iterable[int]) -> Value:
            return self.write & self.address.matches(*_patterns(addresses, len(self.address)))

        # Byte k of the latch takes byte k of every register: all but the highest one, or all of
        # them where the map says that the latch is a register of its own.
        for lane in range(self._size):
            addresses = self._stray if lane == 0 else []
            addresses = addresses + [
                address
                for address, (name, _, byte) in self._places.items()
                if byte == lane
                and (byte < self._registers[name].size - 1 or self._registers[name].assembly)
            ]
            if addresses:
                with m.If(written(addresses)):
                    m.d.sync += latch[8 * lane : 8 * lane + 8].eq(self.data)
        m.d.comb += self.word.eq(Cat(latch[: 8 * (self._size - 1)], self.data))

        for name, register in self._registers.items():
            port, commit = getattr(self, name.lower()), getattr(self, f"{name.lower()}_commit")
            if name == self._latch:
                m.d.comb += port.eq(latch)
                continue
            low = 8 * (register.size - 1)
            word = data.View(layout(register), Cat(latch[:low], self.data))
            for instance in range(len(register.addresses)):
                here = port if len(register.addresses) == 1 else port[instance]
                addresses = [
                    address
                    for address, place in self._places.items()
                    if place == (name, instance, register.size - 1)
                ]
                m.d.comb += commit[instance].eq(written(addresses))
                with m.If(commit[instance]):
                    m.d.sync += [here[field.name].eq(word[field.name]) for field in register.fields]
        return m


def _patterns(addresses: Iterable[int], bits: int) -> list[str]:
    """Return few patterns with don't-cares, such as ``-11--``, that match just these addresses."""
    wanted = set(addresses)
    left, patterns = sorted(wanted), []
    while left:
        fixed = (1 << bits) - 1
        for bit in range(bits):
            fewer = fixed & ~(1 << bit)
            if wanted.issuperset(a for a in range(1 << bits) if not (a ^ left[0]) & fewer):
                fixed = fewer
        shown = [str(left[0] >> bit & 1) if fixed >> bit & 1 else "-" for bit in range(bits)]
        patterns.append("".join(reversed(shown)))
        left = [address for address in left if (address ^ left[0]) & fixed]
    return patterns
