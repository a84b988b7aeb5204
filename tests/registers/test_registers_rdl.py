import pytest

from pulsewright.errors import UsageError
from pulsewright.registers.model import Argument, Choice, Code, Constant, ProfileSwitch, Table

rdl = pytest.importorskip("pulsewright.registers.rdl", exc_type=ImportError)

BOARD = """
`include "properties.rdl"
addrmap demo {
    bridge;
    name = "Demo board";
    desc = "First
            paragraph.

            Second.";
    address_bits = 4;
    constants = '{constant'{name: "CLOCK_HZ", value: 20000000, unit: "Hz", desc: "Core clock."}};
    profiles = '{"exact", "robust"};
    switches = '{profile_switch'{name: "id", unit: "hex", minimum: 16, maximum: 31,
        values: '{18, 19}, meaning: "Answer.", choices: '{}}};
    addrmap {
        default regwidth = 8; default sw = r; default hw = w;
        reg { desc = "Who."; follows = "id";
              field { desc = "Type."; } kind[7:4]; field { desc = "Version."; } version[3:0];
        } ident @ 0x0;
        reg { desc = "Status."; field { desc = "Late."; onread = rclr;
              enum late { no = 0; yes = 1 { desc = "lost"; }; }; encode = late; } late[2:2] = 1;
        } status @ 0x1;
    } read @ 0;
    addrmap {
        default regwidth = 16; default accesswidth = 8; default sw = w; default hw = r;
        reg {
            name = "Axis {n} velocity"; desc = "Rate."; takes_effect = "at the next tick";
            field { desc = "Signed."; is_signed; fracwidth = 10; unit = "step/tick"; }
                velocity[11:0] = 0x801;
        } velocity[4] @ 0x00 += 2;
        regfile {
            desc = "Whole."; takes_effect = "at the high byte"; assembled; commits;
            assembly = "velocity";
            reg { regwidth = 8; field {} value[7:0] = 0x34; } low @ 0;
            reg { regwidth = 8; field {} value[7:0] = 0x12; } high @ 1;
        } limit @ 0x0A;
    } write @ 0;
};
"""


@pytest.fixture
def source(tmp_path):
    def write(text):
        path = tmp_path / "registers.rdl"
        path.write_text(text)
        return path

    return write


def test_a_board_is_read_whole(source):
    board = rdl.read(source(BOARD))
    assert (board.board, board.title, board.address_bits) == ("demo", "Demo board", 4)
    assert board.desc == "First paragraph.\n\nSecond."
    assert board.constants == (Constant("CLOCK_HZ", 20_000_000, "Hz", "Core clock."),)
    assert board.profiles == ("exact", "robust")
    assert board.switches == (ProfileSwitch("id", "Answer.", (18, 19), 16, 31, "hex"),)
    assert [r.key for r in board.registers] == ["R_IDENT", "R_STATUS", "W_VELOCITY", "W_LIMIT"]

    velocity = board["W_VELOCITY"]
    assert (velocity.addresses, velocity.size, velocity.reset) == ((0, 2, 4, 6), 2, 0x801)
    assert velocity.takes_effect == "at the next tick"
    assert velocity.label(2, 1) == "Axis 2 velocity, high byte"
    field = velocity.field("velocity")
    assert (field.lsb, field.width, field.signed, field.fracwidth) == (0, 12, True, 10)
    assert (field.unit, field.minimum, field.maximum) == ("step/tick", -2048, 2047)

    limit = board["W_LIMIT"]
    assert (limit.addresses, limit.size, limit.reset) == ((0x0A,), 2, 0x1234)
    assert (limit.commits, limit.assembly) == (True, "VELOCITY")

    late = board["R_STATUS"].field("late")
    assert (late.lsb, late.reset, late.clear_on_read) == (2, 1, True)
    assert late.choices == (Choice("no", 0), Choice("yes", 1, "lost"))


def test_a_register_that_follows_a_switch_resets_to_its_default(source):
    # 18 is 12 hexadecimal
    ident = rdl.read(source(BOARD))["R_IDENT"]
    assert (ident.reset, ident.field("kind").reset, ident.field("version").reset) == (0x12, 1, 2)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("velocity[11:0] = 0x801", "velocity[11:0]", "reset is missing"),
        ('takes_effect = "at the next tick";', "", "takes_effect is missing"),
        ('desc = "Rate.";', "", "desc is missing"),
        ('desc = "Late.";', "", "desc is missing"),
        ("address_bits = 4;", "", "address_bits is missing"),
        ("address_bits = 4;", "address_bits = 3;", "address 0xb does not fit in 3 address bits"),
        ("values: '{18, 19}", "values: '{18}", "switch id has 1 values for 2 profiles"),
        ("values: '{18, 19}", "values: '{18, 32}", "switch id: 32 is not in 16..31"),
        ('follows = "id"', 'follows = "ident"', "follows 'ident', which is no switch"),
        ("assembled; commits;", "commits;", "neither a register nor an assembled regfile"),
        ("value[7:0] = 0x12", "value[6:0] = 0x12", "each byte of an assembled value is one 8-bit"),
        ("} read @ 0;", "} reads @ 0;", "needs the two addrmaps 'read' and 'write'"),
        ("limit @ 0x0A", "limit @ 0x06", "overlaps with"),
        ('unit = "step/tick"', 'units = "step/tick"', "units"),
        ("bridge;", "bridge", "'bridge' is not defined"),
        ("addrmap demo {", "addrmap demo", r"mismatched input 'bridge' expecting"),
        ("default sw = r;", "default sw = rw;", "is in addrmap 'read'; set sw = r"),
        ('assembly = "velocity"', 'assembly = "b"', "assembly 'b' is no register beside it"),
        ("fracwidth = 10;", 'formula = "2 * {idd}";', "formula of velocity: 'idd' is no switch"),
    ],
)
def test_a_broken_source_is_refused_with_its_place(source, old, new, message):
    assert old in BOARD
    path = source(BOARD.replace(old, new))
    with pytest.raises(UsageError, match=message) as refusal:
        rdl.read(path)
    place = str(refusal.value).split(": ")[0]
    assert place.startswith(f"{path}:")
    assert all(number.isdigit() for number in place.removeprefix(f"{path}:").split(":"))


NUMBERED = """
`include "properties.rdl"
addrmap demo {
    bridge;
    address_bits = 3;
    address_bytes = 2;
    constants = '{constant'{name: "HEADER", value: 0xD5, unit: "hex", desc: "First byte."}};
    tables = '{
        table'{prefix: "INT", title: "Interrupts", unit: "bit", desc: "Pending
                                                                        bits.",
            codes: '{code'{name: "DONE", value: 3, desc: "All is done."}}},
        table'{prefix: "CMD", title: "Commands", unit: "hex", desc: "",
            codes: '{
                code'{name: "STOP", value: 0x10, desc: "Stop."},
                message'{name: "FILL", value: 0x20, desc: "Fill.",
                    arguments: '{argument'{name: "count", size: 1, repeat: ""},
                                 argument'{name: "words", size: 5, repeat: "count"}},
                    reply: '{argument'{name: "left", size: 2, repeat: ""}}}}}};
    addrmap {
        default regwidth = 16; default sw = r; default hw = w;
        reg { desc = "Who."; field { desc = "Type."; } kind[15:0] = 0; } ident @ 3*2;
    } read @ 0x00;
    addrmap {
        default regwidth = 16; default sw = w; default hw = r;
        reg { desc = "All."; takes_effect = "at once"; field { desc = "Run."; } run[0:0] = 0;
        } control @ 0*2;
        regfile {
            reg { desc = "Rate."; takes_effect = "at once"; field { desc = "Step."; } v[15:0] = 0;
            } rate @ 0*2;
            reg { desc = "Time."; takes_effect = "at once"; field { desc = "Wait."; } v[15:0] = 5;
            } wait_time @ 1*2;
        } channel[3] @ 1*2 += 2*2;
    } write @ 0x10;
};
"""


def test_registers_may_be_numbered_and_grouped(source):
    board = rdl.read(source(NUMBERED))
    assert board.numbered
    found = {r.key: (r.addresses, r.size, r.address_bytes) for r in board.registers}
    assert found == {
        "R_IDENT": ((3,), 2, 2),
        "W_CONTROL": ((0,), 2, 2),
        "W_RATE": ((1, 3, 5), 2, 2),
        "W_WAIT_TIME": ((2, 4, 6), 2, 2),
    }
    place = board.at("write", 4)
    assert (place.register.key, place.instance, place.byte) == ("W_WAIT_TIME", 1, 0)
    assert place.label == "wait_time"  # not "..., low byte": the whole register is there
    assert board.at("write", 7) is None
    assert not rdl.read(source(BOARD)).numbered


def test_codes_that_are_no_registers_are_read_with_their_arguments(source):
    board = rdl.read(source(NUMBERED))
    assert board.table("INT") == Table(
        "INT", "Interrupts", (Code("DONE", 3, "All is done."),), "bit", "Pending bits."
    )
    fill = board.table("CMD")["FILL"]
    assert fill.arguments == (Argument("count", 1), Argument("words", 5, "count"))
    assert [argument.text for argument in fill.arguments] == ["count u8", "words u40 x count"]
    assert fill.reply == (Argument("left", 2),)
    assert board.table("CMD").at(0x10).name == "STOP"
    assert board.constants[0].text == "0xD5"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("address_bytes = 2;", "address_bytes = 4;", "has 2 bytes; 4 are at one address"),
        ("ident @ 3*2", "ident @ 8*2", "address 0x8 does not fit in 3 address bits"),
        ("channel[3] @ 1*2 += 2*2", "channel[3] @ 1*2 += 5", "begins within an address; 2 bytes"),
        ("wait_time @ 1*2", "wait_time[1] @ 1*2", "an array of registers has one dimension"),
        ('repeat: "count"', 'repeat: "size"', "FILL: words repeats by 'size', no argument before"),
        ("value: 0x20", "value: 0x10", "table CMD: needs rising values and names of their own"),
        ('name: "FILL"', 'name: "STOP"', "table CMD: needs rising values and names of their own"),
    ],
)
def test_a_broken_numbered_source_is_refused_with_its_place(source, old, new, message):
    assert old in NUMBERED
    path = source(NUMBERED.replace(old, new))
    with pytest.raises(UsageError, match=message) as refusal:
        rdl.read(path)
    assert str(refusal.value).startswith(f"{path}:")


def test_a_missing_source_is_named(tmp_path):
    with pytest.raises(
        UsageError, match=r"no such file; a board has boards/<board>/registers\.rdl"
    ):
        rdl.read(tmp_path / "registers.rdl")
