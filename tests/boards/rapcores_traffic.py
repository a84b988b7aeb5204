"""Random messages, moves, halts and turning encoders, the same for several simulated boards."""

import numpy as np
from rapcores_host import MOVE, READ, STATUS, SWAP

from pulsewright.boards.rapcores import registers as reg

TIMES = range(reg.W_STEP_WIDTH, reg.W_DIR_HOLD + 1)


def play(host, seed, *, least_divider, messages=60, motors=4, encoders=4, half=6, turning=True):
    """Play traffic on a board; return replies, telemetry and the trace of its pins.

    With ``turning`` encoders change at any time, otherwise only at first.
    """
    rng = np.random.default_rng(seed)
    host.half = half
    scale = 1 << 8 * host.bytes - 1
    shift = 8 * host.bytes - 64
    header = [word >> -shift if shift else word for word in (STATUS, SWAP, READ, MOVE)]
    status, swap, read, move = header
    replies, telemetry, quadrature = [], [], [0] * encoders

    def increment(divider_share=1.0):
        kind = rng.integers(6)
        if kind == 0:
            return int(rng.choice([0, 1, -1, -scale, scale - 1, scale // 2, -scale // 2]))
        return int(rng.integers(-scale, scale) * rng.choice([1.0, 0.1, 0.01]) * divider_share)

    def turn(length):
        """Let encoders move while the next frames are sent."""
        cycle = host.free
        while cycle < host.free + length:
            n = int(rng.integers(encoders))
            ups = int(rng.choice([-1, 1, 1, 2])) if rng.random() < 0.95 else 2
            quadrature[n] += ups
            for signal, phase in (("a", quadrature[n]), ("b", quadrature[n] - 1)):
                host.pin(cycle, f"enc{n}_{signal}", int(phase % 4 in (1, 2)))
            cycle += int(rng.choice([1, 1, 2, 3, 20, 200]))

    for number in range(messages):
        kind = rng.integers(16)
        if encoders and (kind % 2 if turning else number == 0):
            turn(int(rng.choice([20, 300, 3000])))
        start = host.free + int(rng.integers(0, 50)) if rng.random() < 0.5 else None
        if kind < 7:
            duration = int(rng.choice([0, 1, 2, 3, 10, 40, 200]))
            words = [w for _ in range(motors) for w in (increment(), increment(1 / 512))]
            telemetry.append(host.send(move, duration, *words, start=start))
        elif kind < 11:
            known = [*range(8), *range(0x44, 0x48), 0x84, 0x85, *range(0xC0, 0xC4)]
            known += [*range(0xE0, 0xEB), 0xA5, 0xB0, 0xFE, 0xFF]
            address = int(rng.choice(known))
            replies.append(host.send(status | address, 0, start=start))
        elif kind == 11:
            which = rng.integers(7)
            if which < 2:
                at, value = reg.W_DIVIDER, least_divider + int(rng.choice([0, 1, 7, 30]))
            elif which < 5:
                at, value = int(rng.choice(TIMES)), int(rng.choice([0, 1, 2, 5, 20, 60]))
            else:
                at = int(rng.choice([0, 1, 0xC4, 0xC5, 0xC6, 0xC7, 0xC9]))
                value = int(rng.integers(1 << 16))
            replies.append(host.send(swap | at, value, start=start))
        elif kind == 12:
            at = int(rng.choice([0, 1, 2, 3, *range(0xC0, 0xC9)]))
            replies.append(host.send(read | at, 0, start=start))
        elif kind == 13 and rng.random() < 0.3:
            cycle = host.free + int(rng.integers(1, 2000))
            host.pin(cycle, "halt", 0)
            host.pin(cycle + int(rng.choice([1, 2, 3, 50, 3000])), "halt", 1)
        elif kind == 14:
            replies.append(host.send(swap | reg.W_CLEAR, int(rng.integers(16)), start=start))
            replies.append(host.send(swap | reg.W_CONTROL, 0))
        else:
            data = rng.integers(0, 256, int(rng.integers(1, 20)), np.uint8).tobytes()
            replies.append(host.board.transfer(host.free, data, half)[0])
            host.free += half * (16 * len(data) + 2) + 2 * half
        if number == 0:
            host.run(host.free + 4000)  # encoders stand still
    host.run(host.free + 20_000)
    return replies, telemetry, host.board.drain()
