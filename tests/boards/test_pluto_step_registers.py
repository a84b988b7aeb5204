"""The register map of pluto-step against the tables of its specification."""

from pulsewright.boards.pluto_step import registers as reg
from pulsewright.boards.pluto_step.registers import MAP
from pulsewright.registers.codec import decode_bytes, encode_bytes


def test_read_side_has_four_bytes_per_register():
    keys = [MAP.at("read", address).register.key for address in range(0, 32, 4)]
    assert keys == ["R_POSITION"] * 4 + ["R_INPUTS", "R_IDENT", "R_STATUS", "R_TICKS"]
    assert [MAP.at("read", address).byte for address in range(32)] == [0, 1, 2, 3] * 8


def test_write_side_repeats_after_sixteen_addresses():
    for address in range(16):
        first, again = MAP.at("write", address), MAP.at("write", address + 16)
        assert (first.register, first.instance, first.byte) == (
            again.register,
            again.instance,
            again.byte,
        )
        assert (first.alias, again.alias) == (False, True)
    assert MAP.at("write", 5).instance == 2
    assert reg.W_VELOCITY_ALIAS == (16, 18, 20, 22)


def test_words_have_the_bits_of_the_tables():
    assert reg.R_POSITION_VALUE_MASK == 0x1FFFFF
    assert reg.W_VELOCITY_VALUE_MASK == 0xFFF
    assert reg.W_OUTPUTS_WATCHDOG_ARM_MASK == 1 << 14
    assert reg.W_OUTPUTS_LEVELS_MASK == 0x3FFF
    fields = {f.name: f.bits for f in MAP["W_TIMING"].fields}
    assert fields == {"polarity": "15", "dirtime": "11:8", "tap": "7:6", "steptime": "3:0"}


def test_fixed_point_numbers_have_eleven_fraction_bits():
    for key, name in (("R_POSITION", "value"), ("W_VELOCITY", "value")):
        field = MAP[key].field(name)
        assert (field.fracwidth, field.signed) == (11, True)
    assert encode_bytes(MAP["W_VELOCITY"], value=-1024) == bytes([0x00, 0x0C])
    assert decode_bytes(MAP["R_POSITION"], bytes([0x00, 0xFC, 0x1F, 0x00])) == {"value": -1024}


def test_clocks_of_the_specification():
    assert (reg.CLOCK_HZ, reg.TICK_HZ, reg.TICK_CYCLES) == (40_000_000, 625_000, 64)
    assert (reg.WATCHDOG_CYCLES, reg.WATCHDOG_TICKS, reg.UNITS_PER_STEP) == (2048, 127, 2048)


def test_identification_word():
    assert reg.R_IDENT_RESET == 0x5057 << 16 | 1 << 8 | 4


def test_every_reset_is_zero_but_the_identification():
    resets = {r.key: r.reset for r in MAP.registers if r.key not in ("R_INPUTS", "R_IDENT")}
    assert set(resets.values()) == {0}


def test_exact_is_the_default_and_switches_everything_off():
    assert reg.DEFAULT_PROFILE == "exact"
    parameters = (
        *("clean_cancel", "enforce_space", "tap_sync", "joint_commit", "wd_stop"),
        *("no_alias", "id_reg", "status_reg", "tick_reg"),
    )
    assert reg.PROFILES["exact"] == {**dict.fromkeys(parameters, 0), "nwait_idle": 1}
    assert reg.PROFILES["extended"] == {**dict.fromkeys(parameters, 1), "nwait_idle": 1}


def test_registers_beyond_the_original_name_their_switch():
    present = {r.key: r.present_with for r in MAP.registers if r.present_with}
    assert present == {
        "R_IDENT": ("id_reg",),
        "R_STATUS": ("status_reg",),
        "R_TICKS": ("tick_reg",),
        "W_SPACE": ("enforce_space",),
        "W_CONTROL": ("joint_commit", "wd_stop"),
    }
