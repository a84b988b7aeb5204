"""Every row of the tables in docs/faults.md, on the twin; where it is about the board, on RTL."""

import math
from contextlib import suppress

import pytest
from fault_scenes import HIT_AT, SECONDS, Case, KilledError, Scene, check_case, check_rows

from pulsewright.errors import PulsewrightError


def link(kind, **arguments):
    """Return a fault of the link."""
    return lambda scene: scene.faults.inject(kind, **arguments)


def killed(scene):
    raise KilledError


def stalled(scene):
    """The host stands still for longer than all that the board knows of the plan."""
    scene.faults.inject("stall", seconds=scene.size.stall, count=1)


def killed_at_a_rate(scene):
    scene.driver.stop()
    scene.driver.set_step_rate(0, 3000)
    raise KilledError


def power_cycle(scene):
    scene.faults.inject("power", on=False)
    with suppress(PulsewrightError):  # the link sees it when it is used
        scene.driver.identify()
    scene.faults.inject("power", on=True)


def plays_again(scene):
    """The board, initialised again, brings a new plan to its end."""
    assert scene.play_again() == scene.end


def tells_and_plays_again(scene):
    """The board tells the next host that it was left in mid-move; then as above."""
    plays_again(scene)
    assert scene.told


def steps_lost(scene):
    """The motor does not make 20 steps that the board gives: the drive has no power, say."""
    scene.counts[0] -= 20


def retried(scene):
    """The driver has sent something again, and nothing else has happened."""
    assert scene.faults.hit
    assert scene.driver.retried


# ------------------------------------------------------------------------------------- usc

LOOP = {"options": {"loopback": 1}}
ENCODERS = {"feedback": True, "options": {"loopback": 1}}


def slip(scene):
    """A motor loses 20 steps: its encoder counts less."""
    count = scene.twin.state()["enc"][0]
    scene.twin.set_encoder(0, count - 20)


def stick(scene):
    """An encoder, which is the loopback of this board, counts no more."""
    scene.twin.set_loopback(False)


def chain_opened(scene):
    """The estop chain opens."""
    if scene.engine == "rtl":
        scene.twin.set_input("estop_chain", 0)
    else:
        scene.twin.set_estop_chain(False)


def switched(number):
    """Return a fault: a switch at an input is hit."""

    def hit(scene):
        if scene.engine == "rtl":
            scene.twin.set_input("din", 1 << number)
        else:
            scene.twin.set_din(1 << number)

    return hit


def noise(scene):
    """Glitches on the lines of an encoder: 15 counts that are no motion."""
    scene.twin.set_encoder(1, scene.twin.state()["enc"][1] + 15)


USC = (
    Case(
        "cable pulled",
        link("mute"),
        "BusTimeoutError",
        "no board acknowledged",
        "10 ms",
        check=plays_again,
        rtl=True,
    ),
    Case("link lost", link("cut"), "BusError", "it is lost", "10 ms", check=plays_again),
    Case(
        "wait line stuck",
        link("stuck"),
        "BusTimeoutError",
        "no board acknowledged",
        "100 ms",
        rtl=True,
    ),
    Case(
        "byte to the board lost",
        link("lose", after=1, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "20 ms",
        LOOP,
    ),
    Case(
        "byte to the board doubled",
        link("double", after=1, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "20 ms",
        LOOP,
    ),
    Case(
        "byte to the board flipped",
        link("flip", mask=0x40, after=3, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "20 ms",
        LOOP,
    ),
    Case(
        "the same three without encoders",
        link("flip", mask=0x40, after=3, count=1),
        silent=True,
        rtl=True,
    ),
    Case(
        "byte from the board flipped",
        link("flip", mask=0x80, of="read", count=1),
        "EstopError",
        "in emergency stop",
        "100 ms",
    ),
    Case("bytes delayed", link("delay", seconds=0.002), "LateError", "came late", "118 ms"),
    Case(
        "host stalled for 1 s",
        link("stall", seconds=1.0, count=1),
        "LateError",
        "came late",
        "10 ms",
        rtl=True,
    ),
    Case("host process killed", killed, "", "", "10 ms", check=plays_again, rtl=True),
    Case("board power-cycled", power_cycle, "EstopError", "in emergency stop", "0 ms", rtl=True),
    Case("encoder stuck", stick, "FollowingError", "an encoder does not count", "20 ms", ENCODERS),
    Case("encoder noisy", noise, "FollowingError", "an encoder does not count", "20 ms", ENCODERS),
    Case("motor steps lost", slip, "FollowingError", "steps were lost", "20 ms", ENCODERS),
    Case("motor steps lost without encoders", steps_lost, silent=True),
    Case(
        "estop opened",
        chain_opened,
        "EstopError",
        "the estop chain opened",
        "0 ms",
        rtl=True,
    ),
    Case(
        "limit switch in the estop chain",
        chain_opened,
        "EstopError",
        "the estop chain opened",
        "0 ms",
        rtl=True,
    ),
    Case(
        "limit switch at an input",
        switched(9),
        "LimitSwitchError",
        "the limit switch at input 9 is hit",
        "20 ms",
        {"inputs": (4, 9)},
        rtl=True,
    ),
)


PLUTO = (
    Case(
        "cable pulled",
        link("mute"),
        "BusTimeoutError",
        "no board acknowledged",
        "6.51 ms",
        check=plays_again,
        rtl=True,
    ),
    Case("link lost", link("cut"), "BusError", "it is lost", "6.51 ms", check=plays_again),
    Case(
        "wait line stuck",
        link("stuck"),
        "BusTimeoutError",
        "no board acknowledged",
        "100 ms",
        rtl=True,
    ),
    Case(
        "byte to the board lost",
        link("lose", after=1, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "100 ms",
        rtl=True,
    ),
    Case(
        "byte to the board doubled",
        link("double", after=1, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "100 ms",
        rtl=True,
    ),
    Case(
        "byte to the board flipped",
        link("flip", mask=0x40, after=1, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "100 ms",
        rtl=True,
    ),
    Case(
        "byte to the timing register flipped",
        lambda scene: scene.driver.write_register("W_TIMING", tap=scene.driver.tap ^ 1),
        silent=True,
    ),
    Case(
        "byte from the board flipped",
        link("flip", mask=0x04, of="read", after=2, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "100 ms",
    ),
    Case("bytes delayed", link("delay", seconds=0.002), "LateError", "came late", "118 ms"),
    Case(
        "host stalled for 1 s",
        link("stall", seconds=1.0, count=1),
        "EstopError",
        "the watchdog expired",
        "6.51 ms",
        rtl=True,
    ),
    Case("host process killed", killed, "", "", "6.51 ms", check=tells_and_plays_again, rtl=True),
    Case(
        "board power-cycled",
        power_cycle,
        "FollowingError",
        "steps from where it was commanded to be",
        "100 ms",
        rtl=True,
    ),
    Case(
        "encoder stuck or noisy",
        None,
        "UsageError",
        "2 encoders given, it has none",
        "0 ms",
        {"feedback": True},
    ),
    Case("motor steps lost", steps_lost, silent=True),
    Case("estop opened", steps_lost, silent=True),
    Case(
        "estop opened, wired to an input",
        switched(4),
        "LimitSwitchError",
        "the limit switch at input 4 is hit",
        "20 ms",
        {"inputs": (4, 9)},
        rtl=True,
    ),
    Case(
        "limit switch at an input",
        switched(9),
        "LimitSwitchError",
        "the limit switch at input 9 is hit",
        "20 ms",
        {"inputs": (4, 9)},
        rtl=True,
    ),
)


# ------------------------------------------------------------------------------------- rapcores


def slip_at_pins(scene):
    scene.turn(HIT_AT, SECONDS, slip=20)


def noise_at_pins(scene):
    """Both signals of an encoder change at once, which no motion does."""
    scene.turn(HIT_AT, SECONDS)
    at = scene.twin.now + 1000
    for pin in ("enc1_a", "enc1_b"):
        scene.twin.schedule([at, at + 40], pin, [1, 0])


def keeps_position(scene):
    """The board counts what it gave, and a new player goes on from there."""
    made = scene.driver.read_steps()[:2].tolist()
    assert made == scene.steps
    scene.set_pin("halt", 1)
    assert scene.play_again() == scene.end


def resumes(scene):
    """The player knows how far it came, and completes the plan."""
    scene.faults.inject("none")
    scene.driver.release_estop()
    scene.driver.reference()  # no step was lost: these motors can stop at once
    scene.player.resume()
    scene.player.play(math.inf)
    scene.note()
    assert scene.steps == scene.end


RAPCORES = (
    Case(
        "cable pulled",
        link("mute"),
        "BusError",
        "no board answers",
        "40 ms",
        check=plays_again,
        rtl=True,
    ),
    Case("link lost", link("cut"), "BusError", "it is lost", "40 ms", check=plays_again),
    Case("wait line BUFFER_DTR stuck low", link("stuck", level=0)),
    Case("wait line BUFFER_DTR stuck high", link("stuck", level=1)),
    Case(
        "byte to the board lost",
        link("lose", after=3, count=1),
        "BusError",
        "framing errors",
        "40 ms",
        rtl=True,
    ),
    Case(
        "byte to the board doubled",
        link("double", after=3, count=1),
        "BusError",
        "framing errors",
        "40 ms",
        rtl=True,
    ),
    Case(
        "byte to the board flipped",
        link("flip", mask=0x10, after=23, count=1),
        "FollowingError",
        "steps from where it was commanded to be",
        "150 ms",
        rtl=True,
    ),
    Case(
        "byte from the board flipped",
        link("flip", mask=0x04, of="read"),
        "BusError",
        "bytes on the way were spoilt",
        "40 ms",
    ),
    Case(
        "bytes delayed",
        link("delay", seconds=0.05),
        "StarvedError",
        "got no move in time",
        "90 ms",
        check=resumes,
    ),
    Case(
        "host stalled for 1 s",
        link("stall", seconds=1.0, count=1),
        "StarvedError",
        "got no move in time",
        "40 ms",
        check=resumes,
        rtl=True,
    ),
    Case("host process killed", killed, "", "", "40 ms", check=plays_again, rtl=True),
    Case(
        "board power-cycled",
        power_cycle,
        "BusError",
        "the board has lost power",
        "40 ms",
        check=plays_again,
        rtl=True,
    ),
    Case(
        "encoder stuck",
        lambda scene: None,
        "FollowingError",
        "an encoder does not count",
        "150 ms",
        {"feedback": True},
        rtl=True,
    ),
    Case(
        "encoder noisy",
        noise_at_pins,
        "FollowingError",
        "has changed both signals at once",
        "150 ms",
        {"feedback": True},
        rtl=True,
    ),
    Case(
        "motor steps lost",
        slip_at_pins,
        "FollowingError",
        "steps were lost",
        "150 ms",
        {"feedback": True},
        rtl=True,
    ),
    Case("motor steps lost without encoders", steps_lost, silent=True),
    Case(
        "estop opened, wired to HALT",
        lambda scene: scene.set_pin("halt", 0),
        "EstopError",
        "the board was halted",
        "0.1 ms",
        check=keeps_position,
        rtl=True,
    ),
    Case(
        "limit switch hit, wired to HALT",
        lambda scene: scene.set_pin("halt", 0),
        "EstopError",
        "the board was halted",
        "0.1 ms",
        check=keeps_position,
        rtl=True,
    ),
)


# ------------------------------------------------------------------------------------- s3g

S3G = (
    Case(
        "cable pulled",
        link("mute"),
        "BusTimeoutError",
        "no reply",
        "500 ms",
        check=plays_again,
        rtl=True,
    ),
    Case("link lost", link("cut"), "BusError", "it is lost", "500 ms", check=plays_again),
    Case("wait line stuck", link("stuck")),
    Case("byte to the board lost", link("lose", after=20, count=1), check=retried, rtl=True),
    Case("byte to the board doubled", link("double", after=20, count=1), check=retried, rtl=True),
    Case(
        "byte to the board flipped",
        link("flip", mask=0x10, after=20, count=1),
        check=retried,
        rtl=True,
    ),
    Case("byte from the board lost", link("lose", of="read", after=2, count=1), check=retried),
    Case(
        "byte from the board flipped",
        link("flip", mask=0x10, of="read", after=2, count=1),
        check=retried,
    ),
    Case("bytes flipped for good", link("flip", mask=0x10, share=0.1), "BusError", "s3g", "500 ms"),
    Case(
        "bytes delayed",
        link("delay", seconds=0.02),
        "StarvedError",
        "has stopped by itself",
        "700 ms",
        check=resumes,
    ),
    Case(
        "host stalled for 1 s",
        stalled,
        "StarvedError",
        "has stopped by itself",
        "500 ms",
        check=resumes,
        rtl=True,
    ),
    Case("host process killed", killed, "", "", "500 ms", check=tells_and_plays_again, rtl=True),
    Case("host process killed while a rate is set", killed_at_a_rate, "", "", "never", rtl=True),
    Case(
        "board power-cycled",
        power_cycle,
        "BusError",
        "it has lost power or was reset",
        "0 ms",
        check=plays_again,
        rtl=True,
    ),
    Case(
        "encoder stuck or noisy",
        None,
        "UsageError",
        "2 encoders given, it has none",
        "0 ms",
        {"feedback": True},
    ),
    Case("motor steps lost", steps_lost, silent=True),
    Case("estop opened", steps_lost, silent=True),
    Case("limit switch hit", steps_lost, silent=True),
    Case(
        "limit switch at an input",
        None,
        "UsageError",
        "it has no digital inputs",
        "0 ms",
        {"inputs": (0,)},
    ),
)

CASES = {"usc": USC, "pluto_step": PLUTO, "rapcores": RAPCORES, "s3g": S3G}


def ids(cases):
    return [f"{board}-{case.name}" for board, case in cases]


ALL = [(board, case) for board, cases in CASES.items() for case in cases]
ON_RTL = [(board, case) for board, case in ALL if case.rtl]


@pytest.mark.parametrize(("board", "case"), ALL, ids=ids(ALL))
def test_on_the_twin(board, case):
    check_case(board, case)


@pytest.mark.parametrize("board", CASES)
def test_table_and_cases_agree(board):
    check_rows(board, CASES[board])


@pytest.mark.parametrize("real_time", [True, False])
def test_a_late_host_is_told_of_the_closed_loop_on_links_in_real_time(real_time):
    scene = Scene("usc")
    scene.driver.bus.in_real_time = real_time
    scene.play(link("delay", seconds=0.002))
    assert type(scene.error).__name__ == "LateError"
    told = "\n".join(getattr(scene.error, "__notes__", ()))
    assert ("[encoders]" in told) == ("loopback" in told) == real_time


NOISY = {"usc": LOOP, "rapcores": {}, "s3g": {}}  # pluto_step: not its timing register


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("board", NOISY)
def test_noise_on_the_link_never_ends_in_a_silent_position_error(board, seed):
    """Some bytes lost, doubled and flipped, both ways, until the end: an error, or every step."""
    scene = Scene(board, seed=seed, **NOISY[board])
    share = 10.0 ** -(2 + seed % 3)

    def noise(scene):
        for of in ("read", "write"):
            scene.faults.inject("lose", of=of, share=share)
            scene.faults.inject("double", of=of, share=share)
            scene.faults.inject("flip", of=of, share=share, mask=1 << seed)

    scene.play(noise)
    assert scene.faults.hit
    assert scene.error or scene.steps == scene.end


@pytest.mark.rtl
@pytest.mark.campaign
@pytest.mark.parametrize(("board", "case"), ON_RTL, ids=ids(ON_RTL))
def test_on_rtl(board, case):
    check_case(board, case, "rtl")
