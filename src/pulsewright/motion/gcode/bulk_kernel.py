"""Plain motion lines, read in bulk: from the bytes of a program to ends of moves.

A plain line holds a line number, G0 or G1, axis words and F, with numbers or arithmetic of numbers
and named parameters. The kernel gives back the first line that is anything else, untouched.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pulsewright.compiled import compiled

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DEPTH = 32  # operands and brackets that wait
EXACT = 1 << 53  # integers below are exact as float64
DIGITS = 18  # that fit into an integer; powers of ten up to this one are exact, too

# Members of the state, before the position.
ABSOLUTE, MOTION, FEED, SCALE, POSITION = 0, 1, 2, 3, 4

_POINT = ord(".") - ord("0")
_OPEN, _NEGATIVE, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE = 0, 1, 2, 3, 4, 5


@compiled(allocates=False)
def _skip(data: Bytes, i: int) -> int:
    """Return the next place that is not blank."""
    while data[i] == 32 or data[i] == 9:
        i += 1
    return i


@compiled(allocates=False)
def _number(data: Bytes, i: int, powers: Floats) -> tuple[int, float]:
    """Read a number without sign or blanks at ``i``; return where it ends, -1 where it is none.

    What follows is not looked at: blanks and then more of it are nothing that may follow a value.
    """
    mantissa, start, decimals = 0, i, 0
    digit = int(data[i]) - 48
    while 0 <= digit <= 9:
        mantissa = mantissa * 10 + digit
        i += 1
        digit = int(data[i]) - 48
    length = i - start
    if digit == _POINT:
        i += 1
        start = i
        digit = int(data[i]) - 48
        while 0 <= digit <= 9:
            mantissa = mantissa * 10 + digit
            i += 1
            digit = int(data[i]) - 48
        decimals = i - start
        length += decimals
    if digit == _POINT or not 0 < length <= DIGITS or mantissa >= EXACT:
        return -1, 0.0
    return i, mantissa / powers[decimals]


@compiled(allocates=False)
def _name(data: Bytes, i: int, names: Bytes, bounds: Integers, values: Floats) -> tuple[int, float]:
    """Read a named parameter, whose name begins at ``i``."""
    for k in range(len(values)):
        at, j = i, bounds[k]
        while True:
            c = data[at]
            at += 1
            if c == 32 or c == 9:
                continue
            if c == 62:  # >
                if j == bounds[k + 1]:
                    return at, values[k]
                break
            if 97 <= c <= 122:
                c -= 32
            if j == bounds[k + 1] or c != names[j]:
                break
            j += 1
    return -1, 0.0


@compiled(allocates=False)
def _reduce(operators: Integers, operands: Floats, m: int, n: int) -> bool:
    """Carry out the last operator; whether there is a result."""
    left, right = operands[n - 2], operands[n - 1]
    operator = operators[m - 1]
    if operator == _ADD:
        result = left + right
    elif operator == _SUBTRACT:
        result = left - right
    elif operator == _MULTIPLY:
        result = left * right
    elif right == 0.0:
        return False
    else:
        result = left / right
    operands[n - 2] = result
    return math.isfinite(result)


@compiled(allocates=False)
def _value(
    data: Bytes,
    i: int,
    powers: Floats,
    names: Bytes,
    bounds: Integers,
    values: Floats,
    operands: Floats,
    operators: Integers,
) -> tuple[int, float]:
    """Read the value of a word at ``i``; return where it ends, -1 where it is not plain."""
    n = m = 0  # operands and operators that wait
    while True:
        # an operand, perhaps with a sign and brackets before it
        negative = False
        i = _skip(data, i)
        if data[i] == 45 or data[i] == 43:
            negative = data[i] == 45
            i = _skip(data, i + 1)
        c = data[i]
        if c == 91:  # [
            if m == DEPTH:
                return -1, 0.0
            operators[m] = _NEGATIVE if negative else _OPEN
            m += 1
            i += 1
            continue
        if n == DEPTH:
            return -1, 0.0
        if c == 35:  # #
            i = _skip(data, i + 1)
            if data[i] != 60:
                return -1, 0.0
            i, operands[n] = _name(data, i + 1, names, bounds, values)
        else:
            i, operands[n] = _number(data, i, powers)
        if i < 0:
            return -1, 0.0
        if negative:
            operands[n] = -operands[n]
        n += 1
        # then closing brackets, an operator, or the end
        while True:
            if m == 0:
                return i, operands[0]
            i = _skip(data, i)
            c = data[i]
            if c != 93:  # ]
                break
            while operators[m - 1] > _NEGATIVE:
                if not _reduce(operators, operands, m, n):
                    return -1, 0.0
                m -= 1
                n -= 1
            if operators[m - 1] == _NEGATIVE:
                operands[n - 1] = -operands[n - 1]
            m -= 1
            i += 1
        if c == 43:
            operator = _ADD
        elif c == 45:
            operator = _SUBTRACT
        elif c == 47:
            operator = _DIVIDE
        elif c == 42:
            operator = _MULTIPLY
            if data[_skip(data, i + 1)] == 42:
                return -1, 0.0  # **
        else:
            return -1, 0.0
        while operators[m - 1] > _NEGATIVE and operators[m - 1] // 2 >= operator // 2:
            if not _reduce(operators, operands, m, n):
                return -1, 0.0
            m -= 1
            n -= 1
        if m == DEPTH:
            return -1, 0.0
        operators[m] = operator
        m += 1
        i += 1


@compiled(allocates=False)
def read(
    data: Bytes,
    offset: int,
    line: int,
    columns: Integers,
    farthest: float,
    powers: Floats,
    names: Bytes,
    bounds: Integers,
    values: Floats,
    operands: Floats,
    operators: Integers,
    state: Floats,
    lines: NDArray[np.int32],
    ends: Floats,
    feeds: Floats,
) -> tuple[int, int, int]:
    """Read plain lines from ``offset`` on.

    Parameters
    ----------
    data : (n,) uint8
        The text; it ends with a line end.
    offset, line : int
        Where to begin: a byte, and the number of its line, from 1.
    columns : (26,) int64
        Column of the position for each letter; -1 for letters that are no axis of the machine.
    farthest : float
        An axis stays within this on either side.
    powers : (19,) float64
        Powers of ten.
    names, bounds, values : uint8, int64, float64
        Named parameters: the bytes of all names, where each begins, and their values.
    operands, operators : (32,) float64, (32,) int64
        Room to work in.
    state : (10,) float64
        Whether distances are absolute, motion code (0, 1; else -1), feed, mm/s of feed 1, and the
        position. Changed in place.
    lines, ends, feeds : (m,) int32, (m, 6) float64, (m,) float64
        Filled in for each move; the feed in mm/s, infinite for rapids.

    Returns
    -------
    offset, line, moves : int
        What comes next, and how many moves there are. Reading ends at a line that is not plain, at
        the end, or with the arrays full.
    """
    count, size = 0, len(data)
    while offset < size and count < len(lines):
        motion, feed, seen, has_feed, has_code = state[MOTION], state[FEED], 0, False, False
        plain = True
        i = _skip(data, offset)
        if data[i] == 78 or data[i] == 110:  # N
            i, _ = _number(data, i + 1, powers)
            if i < 0:
                break
        while True:
            i = _skip(data, i)
            c = data[i]
            if c == 10:
                break
            if c == 59:  # ;
                while data[i] != 10:
                    i += 1
                break
            if 97 <= c <= 122:
                c -= 32
            plain = False
            if not 65 <= c <= 90:
                break
            axis = columns[c - 65]
            if axis < 0 and c != 70 and c != 71:
                break
            i = _skip(data, i + 1)
            if 48 <= data[i] <= 57:
                i, value = _number(data, i, powers)
            elif data[i] == 45 and 48 <= data[i + 1] <= 57:
                i, value = _number(data, i + 1, powers)
                value = -value
            else:
                i, value = _value(data, i, powers, names, bounds, values, operands, operators)
            if i < 0:
                break
            if c == 71:  # G
                if has_code or (value != 0.0 and value != 1.0):
                    break
                has_code, motion = True, value
            elif c == 70:  # F
                if has_feed or value < 0.0:
                    break
                has_feed, feed = True, value
            else:
                if seen >> axis & 1:
                    break
                seen |= 1 << axis
                ends[count, axis] = value
            plain = True
        if not plain:
            break
        if seen:
            if motion < 0.0 or (motion == 1.0 and feed <= 0.0):
                break
            far = False
            for axis in range(6):
                here = state[POSITION + axis]
                if not seen >> axis & 1:
                    ends[count, axis] = here
                    continue
                if not state[ABSOLUTE]:
                    ends[count, axis] += here
                far |= not -farthest < ends[count, axis] < farthest
            if far:
                break
            for axis in range(6):
                state[POSITION + axis] = ends[count, axis]
            lines[count] = line
            feeds[count] = math.inf if motion == 0.0 else feed * state[SCALE] / 60.0
            count += 1
        elif has_code and motion == 1.0 and feed <= 0.0 and has_feed:
            break
        state[MOTION], state[FEED] = motion, feed
        offset = i + 1
        line += 1
    return offset, line, count
