"""Assembler, disassembler and checks; words are worked out from the document's table of formats."""

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pulsewright.boards.s3g import program
from pulsewright.boards.s3g.packets import Decoder
from pulsewright.boards.s3g.program import Finding, assemble, disassemble, instruction
from pulsewright.errors import SourceError

PACKETS = Path(__file__).parents[1] / "golden/s3g/packets.jsonl"


def words(text):
    return [item.word for item in assemble(text).instructions]


def findings(text, **board):
    return [(f.severity, f.line, f.message) for f in program.check(assemble(text), **board)]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        # class 01, register, value
        ("OUTPUT LEDS, 0x3C", 0x40_0000003C),
        ("OUTPUT SE_REG_LB, 0x12345678", 0x7F_12345678),
        ("OUTPUT V_VAL[0], -16384", 0x4A_FFFFC000),
        ("OUTPUT V_VAL[1], 16384", 0x52_00004000),
        ("OUTPUT ABORT_A_VAL[5], 1", 0x77_00000001),
        ("OUTPUT ASG_CONTROL2, SET_TARGET_V[3]", 0x7C_00000020),
        ("OUTPUT MSG_CONTROL, ENABLE[0] | ENABLE[1]", 0x47_00000003),
        ("OUTPUT 61, 0x1", 0x7D_00000001),
        # class 10, opcode, mask: bits 31, 0, 30 and 1
        ("NOP", 0x80_00000000),
        ("NOP 0x5", 0x80_00000005),
        ("STB SE_INT_LB", 0x81_80000000),
        ("WAIT_ALL ASG_DONE | BE_COMPLETE", 0x82_40000001),
        ("WAIT_ANY ASG_ABORT", 0x83_00000002),
        ("CLEAR 0xFFFFFFFF", 0x84_FFFFFFFF),
        ("WAIT_ALL 0", 0x82_00000000),
        ("DONE 7", 0xBF_00000007),
        # classes 00 and 11, opcodes 5 to 62
        (".word 0x0000000001", 0x00_00000001),
        (".word 0xC000000000", 0xC0_00000000),
        (".word 0x8500000000", 0x85_00000000),
        (".word 0xBE00000000", 0xBE_00000000),
    ],
)
def test_an_instruction_is_its_word_and_its_word_is_the_instruction(text, word):
    assert words(text) == [word]
    assert instruction(word) == text


def test_the_load_control_of_the_worked_chain_by_names():
    # specification, vector 12: register 3 = 1F0F
    text = "OUTPUT ASG_CONTROL, STEPS_LIMIT | DT_LIMIT | RESET_STEPS | RESET_DT"
    text += " | SET_X[0] | SET_V[0] | SET_A[0] | SET_J[0] | SET_JJ[0]"
    assert words(text) == [0x43_00001F0F]
    assert instruction(0x43_00001F0F) == text


def test_numbers_are_written_in_any_base_and_sign():
    same = ["-1", "0xFFFFFFFF", "0xffff_ffff", "4294967295", "0b" + "1" * 32, "4_294_967_295"]
    assert {words(f"OUTPUT 0, {number}")[0] for number in same} == {0x40_FFFFFFFF}
    assert words("STB 0x80000000|ASG_LOAD") == [0x81_80000001]


def test_labels_and_places():
    source = """
    ; a comment alone
    start: again:
        output leds, 1      ; any case
        DONE 0
    .org 100
    late: OUTPUT BE_START_ADDR, end | 0x8000
        OUTPUT 63, start
    end:
    """
    made = assemble(source, "p.txt")
    assert made.pieces() == [
        (0, [0x40_00000001, 0xBF_00000000]),
        (100, [0x7E_00008066, 0x7F_00000000]),
    ]
    assert made.labels == {"start": 0, "again": 0, "late": 100, "end": 102}
    places = [(item.address, item.line, item.column) for item in made.instructions]
    assert places == [(0, 4, 9), (1, 5, 9), (100, 7, 11), (101, 8, 9)]


def test_pieces_that_touch_are_one_and_are_in_order():
    made = assemble(".org 1\nNOP\n.org 0\nDONE 0")
    assert made.pieces() == [(0, [0xBF_00000000, 0x80_00000000])]


def test_words_that_follow_each_other_need_no_org():
    assert disassemble([(0, [0x80 << 32]), (1, [0x80 << 32])]) == "    NOP\n    NOP\n"


def test_text_that_was_disassembled_comes_back_as_it_was():
    text = (
        ".org 5\n    OUTPUT J_VAL[0], -3\n    OUTPUT ASG_DT_VAL, 50000\n"
        ".org 8000\n    WAIT_ANY ASG_DONE | ASG_ABORT\n    DONE 0\n"
    )
    assert disassemble(assemble(text).pieces()) == text


known = st.builds(
    lambda head, data: head << 32 | data,
    st.one_of(st.integers(0x40, 0x7F), st.integers(0x80, 0x85), st.just(0xBF)),
    st.one_of(st.integers(0, (1 << 32) - 1), st.sampled_from([1, 2, 3, 1 << 31, 0xC0000003])),
)


@given(st.one_of(known, st.integers(0, (1 << 40) - 1)))
def test_every_word_survives_its_text(word):
    assert words(instruction(word)) == [word]


@given(st.dictionaries(st.integers(0, 0xFFFF), known, max_size=12))
def test_a_memory_survives_its_text(memory):
    pieces = [(address, [word]) for address, word in sorted(memory.items())]
    made = assemble(disassemble(pieces))
    assert {item.address: item.word for item in made.instructions} == memory
    assert disassemble(assemble(disassemble(made.pieces())).pieces()) == disassemble(made.pieces())


def test_programs_that_the_original_was_sent_survive_their_text():
    sent = []
    for scenario in map(json.loads, PACKETS.read_text().splitlines()):
        for packet in scenario["packets"]:
            for payload in Decoder(255).feed(bytes.fromhex(packet[3])):
                if packet[0] != "out" and payload[2] == 65:
                    tail = payload[6:]
                    sent += [tail[i : i + 5] for i in range(0, len(tail) - 4, 5)]
    memory = [int.from_bytes(word, "little") for word in sent]
    assert len(memory) > 90
    made = assemble(disassemble([(0, memory)]))
    assert made.pieces() == [(0, memory)]


# ---- what is refused


@pytest.mark.parametrize(
    ("source", "place", "message"),
    [
        ("FOO 1", "1:1", "no instruction 'FOO'; there are OUTPUT, NOP, STB,"),
        ("\n  WAITALL 1", "2:3", "no instruction 'WAITALL'; there are WAIT_ALL"),
        ("5", "1:1", "wanted is an instruction; this is something else"),
        ("OUTPUT V_VAL, 3", "1:8", r"no register 'V_VAL'; there are V_VAL\[0\], V_VAL\[1\]"),
        ("OUTPUT V_VAL[6], 3", "1:8", r"no register 'V_VAL\[6\]'; there are V_VAL\[0\]"),
        ("OUTPUT V_VAL[1, 3", "1:15", "wanted is a closing bracket"),
        ("OUTPUT LED, 3", "1:8", r"no register 'LED'; did you mean LEDS\?"),
        ("OUTPUT 64, 3", "1:8", r"does not fit; wanted is a register 0\.\.63"),
        ("OUTPUT LEDS 3", "1:13", "wanted is a comma and a value"),
        ("OUTPUT LEDS,", "1:13", r"wanted is a number -2147483648\.\.4294967295; the line ends"),
        ("OUTPUT LEDS, 0x100000000", "1:14", "does not fit"),
        ("OUTPUT LEDS, -2147483649", "1:14", "does not fit"),
        ("OUTPUT LEDS, -1 | 1", "1:14", "a negative number cannot be joined"),
        ("OUTPUT LEDS, 1 | -1", "1:18", "a negative number cannot be joined"),
        ("a:\nOUTPUT LEDS, b", "2:14", "no name of a bit or label 'B'; there are a"),
        ("STB ASG_DONE", "1:5", r"no strobe 'ASG_DONE'; did you mean ASG_LOAD\?"),
        ("WAIT_ALL FOREVER", "1:10", "no interrupt 'FOREVER'; there are ASG_DONE, ASG_ABORT"),
        ("DONE", "1:5", "wanted is a number .*; the line ends"),
        ("DONE ASG_DONE", "1:6", "wanted is a number"),
        ("NOP 1 2", "1:7", "the instruction is complete before this"),
        (".word 0x10000000000", "1:7", r"wanted is a word 0\.\.0xFFFFFFFFFF"),
        (".org 65536", "1:6", r"wanted is an address 0\.\.65535"),
        (".org 65535\nNOP\nNOP", "3:1", "address 65536 is beyond the last, 65535"),
        ("NOP\n.org 0\nDONE 1", "3:1", "address 0 has the instruction of line 1"),
        ("a: NOP\na: DONE 1", "2:1", "this label is address 0 already"),
        ("leds: NOP", "1:1", "a label needs a name that is not one of the board's"),
        ("a: .org 5", "1:1", r"a label names the address after \.org"),
        ("OUTPUT LEDS, 12ab", "1:14", "no number, name or sign"),
        ("OUTPUT LEDS, $3", "1:14", "no number, name or sign"),
    ],
)
def test_a_wrong_line_is_named_with_its_place_and_what_is_allowed(source, place, message):
    with pytest.raises(SourceError, match=message) as refusal:
        assemble(source, "p.txt")
    assert str(refusal.value).startswith(f"p.txt:{place}: ")
    assert place == f"{refusal.value.line}:{refusal.value.column}"


# ---- what is found


def test_a_good_program_has_no_findings():
    assert findings("WAIT_ANY ASG_DONE\nCLEAR ASG_DONE\nSTB ASG_LOAD\nDONE 0") == []


@pytest.mark.parametrize(
    ("source", "severity", "line", "message"),
    [
        ("", "error", 1, "there is no instruction"),
        (".word 0x8500000000", "error", 1, "word 8500000000 is illegal"),
        (".word 5", "error", 1, "word 0000000005 is illegal"),
        ("WAIT_ANY 0\nDONE 0", "error", 1, "never goes on: none of its interrupts"),
        ("WAIT_ANY 0x4\nDONE 0", "error", 1, "never goes on: none of its interrupts"),
        ("WAIT_ALL 0x5\nDONE 0", "error", 1, "never goes on: interrupts 0x4 are never"),
        ("NOP\nCLEAR 1", "error", 2, "DONE is missing: the executor goes on to address 2"),
        ("DONE 0\n.org 9\nNOP", "error", 3, "DONE is missing: .* address 10"),
        (".org 8192\nDONE 0", "error", 2, "beyond the program memory of 8192 words; .* at 0"),
        ("OUTPUT 61, 1\nDONE 0", "warning", 1, "register 61 has no function with 2 channels"),
        ("OUTPUT V_VAL[2], 1\nDONE 0", "warning", 1, r"register V_VAL\[2\] has no function"),
        ("OUTPUT ASG_CONTROL2, 1\nDONE 0", "warning", 1, "ASG_CONTROL2 has no function"),
        ("OUTPUT MSG_CONTROL, 4\nDONE 0", "warning", 1, "bits 0x4 of register MSG_CONTROL"),
        ("OUTPUT ASG_CONTROL, SET_X[2]\nDONE 0", "warning", 1, "bits 0x1000000 of register"),
        ("OUTPUT LEDS, 0x1FF\nDONE 0", "warning", 1, "bits 0x100 of register LEDS"),
        ("STB 0x2\nDONE 0", "warning", 1, "strobes 0x2 have no function"),
        ("STB BE_START\nDONE 0", "warning", 1, "BE_START is ignored while a program runs"),
        ("WAIT_ALL 0\nDONE 0", "warning", 1, "waits for nothing"),
        ("DONE 0x101", "warning", 1, "only the low 8 bits become the error code: 0x01"),
        ("DONE 2", "warning", 1, "code 0x02 looks like WAITING"),
        ("DONE 0\nNOP\nNOP", "warning", 2, "never reached: the program ends at line 1"),
        ("STB BE_ABORT\nNOP", "warning", 2, "never reached"),
    ],
)
def test_what_cannot_work_is_found(source, severity, line, message):
    [(found, at, text)] = findings(source)
    assert (found, at) == (severity, line)
    assert re.search(message, text)


@pytest.mark.parametrize(
    ("source", "board"),
    [
        ("OUTPUT V_VAL[2], 1\nOUTPUT ASG_CONTROL, SET_X[2]\nDONE 0", {"channels": 3}),
        ("OUTPUT ASG_CONTROL2, SET_X[3]\nOUTPUT MSG_CONTROL, 15\nDONE 0", {"channels": 4}),
        (".org 8192\nDONE 0", {"prog_words": 16384}),
        ("DONE 0\nagain: DONE 1", {}),
        ("first: DONE 0\n.org 8191\nNOP", {}),  # memory wraps: 8191 is followed by 0
    ],
)
def test_what_works_on_the_board_asked_for_is_not(source, board):
    assert findings(source, **board) == []


def test_a_finding_knows_its_column():
    made = assemble("x: WAIT_ANY 0\nDONE 0")
    assert program.check(made) == [
        Finding("error", 1, 4, "never goes on: none of its interrupts is ever pending")
    ]


def test_the_program_of_the_readme_has_no_findings():
    text = Path(program.__file__).with_name("README.md").read_text(encoding="utf-8")
    [source] = re.findall(r"```text\n(.*?)```", text, re.DOTALL)
    made = assemble(source)
    assert made.labels == {"move": 4}
    assert len(made.instructions) == 16
    assert program.check(made) == []


def test_the_program_at_the_top_of_the_module_has_no_findings():
    source = program.__doc__.split("::\n\n")[1].split("\n\nNumbers")[0]
    made = assemble(source)
    assert (made.labels, made.instructions[0].address) == ({"cruise": 16}, 16)
    assert program.check(made) == []
