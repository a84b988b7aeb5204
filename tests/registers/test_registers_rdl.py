import pytest

from pulsewright.errors import UsageError
from pulsewright.registers.model import Choice, Constant, ProfileSwitch

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


def test_a_missing_source_is_named(tmp_path):
    with pytest.raises(
        UsageError, match=r"no such file; a board has boards/<board>/registers\.rdl"
    ):
        rdl.read(tmp_path / "registers.rdl")
