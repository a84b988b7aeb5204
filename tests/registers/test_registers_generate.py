import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pulsewright.errors import UsageError
from pulsewright.registers import generate, render

pytest.importorskip("systemrdl")

ROOM = "src/pulsewright/boards/usc"
PRODUCTS = [
    f"{ROOM}/registers.py",
    "docs/registers/usc.md",
    "docs/registers/usc.json",
    "docs/registers/usc.h",
]


@pytest.fixture
def checkout(tmp_path):
    """A checkout with one board, freshly generated."""
    (tmp_path / ROOM).mkdir(parents=True)
    shutil.copy(generate.CHECKOUT / ROOM / "registers.rdl", tmp_path / ROOM)
    assert generate.run(tmp_path) == [tmp_path / name for name in PRODUCTS]
    return tmp_path


def test_committed_products_are_those_of_their_sources():
    assert generate.run(check=True) == []


def test_a_second_run_writes_nothing(checkout):
    assert generate.run(checkout) == []


@pytest.mark.parametrize("name", PRODUCTS)
def test_check_finds_an_edited_product_and_leaves_it(checkout, name, capsys):
    path = checkout / name
    edited = path.read_text().replace("40", "41", 1)
    path.write_text(edited)
    assert generate.main(["--check", "--root", str(checkout)]) == 1
    assert str(path) in capsys.readouterr().out
    assert path.read_text() == edited
    assert generate.main(["--root", str(checkout)]) == 0
    assert generate.main(["--check", "--root", str(checkout)]) == 0


def test_check_finds_an_edited_source_and_a_missing_product(checkout):
    source = checkout / ROOM / "registers.rdl"
    source.write_text(source.read_text().replace("code[7:0] = 0xFE", "code[7:0] = 0xFD", 1))
    (checkout / PRODUCTS[1]).unlink()
    assert generate.run(checkout, check=True) == [checkout / name for name in PRODUCTS]


def test_a_new_room_needs_no_change(checkout):
    room = checkout / "src/pulsewright/boards/demo"
    room.mkdir()
    text = (checkout / ROOM / "registers.rdl").read_text().replace("addrmap usc", "addrmap demo")
    (room / "registers.rdl").write_text(text)
    made = generate.run(checkout)
    assert made[0] == room / "registers.py"
    assert made[1:] == [checkout / f"docs/registers/demo.{ext}" for ext in ("md", "json", "h")]


def test_a_map_that_is_not_named_as_its_room_is_refused(checkout, capsys):
    source = checkout / ROOM / "registers.rdl"
    source.write_text(source.read_text().replace("addrmap usc", "addrmap acme"))
    assert generate.main(["--root", str(checkout)]) == 1
    assert "the address map is 'acme', must be 'usc'" in capsys.readouterr().err


def test_a_folder_that_is_no_checkout_is_refused(tmp_path):
    with pytest.raises(UsageError, match="generate in a checkout"):
        generate.run(tmp_path)


def test_generated_python_gives_the_map_that_was_read(checkout):
    from pulsewright.registers import rdl

    names = {}
    exec((checkout / PRODUCTS[0]).read_text(), names)
    assert names["MAP"] == rdl.read(checkout / ROOM / "registers.rdl")


def test_generated_python_is_formatted_and_clean():
    ruff = Path(sys.executable).with_name("ruff")
    if not ruff.exists():
        pytest.skip("no ruff beside this Python")
    path = generate.CHECKOUT / PRODUCTS[0]
    for command in (["format", "--check"], ["check"]):
        done = subprocess.run(
            [ruff, *command, "--no-cache", path], capture_output=True, check=False
        )
        assert done.returncode == 0, done.stdout


def test_numbered_registers_and_codes_become_constants():
    names = {}
    exec((generate.CHECKOUT / "src/pulsewright/boards/s3g/registers.py").read_text(), names)
    assert names["W_V_VAL"] == (10, 18, 26, 34, 42, 50)
    text = generate.python(names["MAP"])
    assert "\nR_BE_CONTROL: Final = 62\n" in text
    assert "\n# Interrupts [bit]\nINT_ASG_DONE: Final = 0\n" in text
    assert "\nREPLY_INTERRUPT: Final = 0x50\n" in text
    assert "\n# First byte of a packet.\nHEADER: Final = 0xD5\n" in text
    assert "\n# Clock of everything. [Hz]\nCLOCK_HZ: Final = 50_000_000\n" in text


def test_strings_are_quoted_and_broken_without_loss():
    text = 'say "it\'s" \\ ' + "word " * 40 + "\n\nlast line"
    rows = generate._expression(text, "desc=", 8, suffix=",")
    assert all(len(row) <= generate.WIDTH for row in rows)
    assert eval("".join(rows).strip().removeprefix("desc=").removesuffix(",")) == text


def test_json_holds_what_the_map_says(checkout):
    page = json.loads((checkout / PRODUCTS[2]).read_text())
    assert page["format"] == render.JSON_FORMAT
    assert (page["board"], page["address_bits"]) == ("usc", 5)
    divisor = next(r for r in page["registers"] if r["key"] == "W_DIVISOR")
    assert (divisor["addresses"], divisor["size"]) == ([0x10, 0x13, 0x16, 0x19], 3)
    assert divisor["fields"][0]["mask"] == 0xFFFFFF
    assert divisor["fields"][0]["maximum"] == 16_777_215


C_PROGRAM = """
#include "usc.h"
#define SAME(name, condition) typedef char name[(condition) ? 1 : -1];
SAME(a, USC_W_DIVISOR(3) == 0x19)
SAME(b, USC_W_TIMER_SOFT_LATCH_MASK == 0x20 && USC_W_TIMER_SOFT_LATCH_LSB == 5)
SAME(c, USC_R_IDENT_RESET == 0x41 && USC_R_IDENT_TYPE_USC == 4)
SAME(d, USC_DOCUMENT_DIV_OFFSET == 1 && USC_LINUXCNC_DIV_OFFSET == 4)
SAME(e, USC_W_ENCODER_CONTROL_ALIAS == 3 && USC_CLOCK_HZ == 40000000)
SAME(f, USC_R_ENCODER_COUNT_INSTANCES == 4 && USC_R_ENCODER_COUNT_SIZE == 3)
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
def test_the_header_compiles_as_c90_and_holds_the_documents_numbers(checkout):
    program = checkout / "docs/registers/program.c"
    program.write_text(C_PROGRAM)
    flags = ["-std=c90", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    done = subprocess.run(["gcc", *flags, program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
