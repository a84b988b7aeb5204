"""What the machine is and may do: axes, limits, drives and wiring, from a TOML file."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterator, Sequence
from fractions import Fraction
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NoReturn, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails

from pulsewright.errors import MachineError, MotionLimitError
from pulsewright.motion.kinematics import KINEMATICS
from pulsewright.motion.moves import AXES, MoveKind, Moves

LINEAR: Final = "XYZ"
TRAVEL_MARGIN: Final = 1e-6  # rounding of programs in inches [mm, degrees]
RISE: Final = 0.025  # time in which an axis without a jerk limit builds up its acceleration [s]
LEAST_RISE: Final = 0.001  # and the shortest time in which any axis does [s]
NUMBER = r"[0-9]+(?:\.[0-9]*)?|\.[0-9]+"

WORK_OFFSETS: Final = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


def _exact(value: Any) -> Fraction:
    """Return a scale exactly: a number, or a string such as ``"200*16/5"`` or ``"3200/1.27"``."""
    allowed = 'a number above 0, or one as an exact string such as "200*16/5" or "3200/1.27"'
    if isinstance(value, Fraction):
        scale = value
    elif isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        scale = Fraction(str(value))  # the decimal number that was written, not its binary rounding
    elif isinstance(value, str) and re.fullmatch(
        rf"\s*(?:{NUMBER})\s*(?:[*/]\s*(?:{NUMBER})\s*)*", value
    ):
        scale = Fraction(1)
        for operator, number in re.findall(rf"([*/]?)\s*({NUMBER})", value):
            factor = Fraction(number)
            if operator == "/" and factor == 0:
                raise ValueError(f"divides by zero; allowed is {allowed}")
            scale = scale / factor if operator == "/" else scale * factor
    else:
        raise ValueError(f"allowed is {allowed}")
    if scale <= 0:
        raise ValueError(f"allowed is {allowed}")
    return scale


def _motor_tuple(value: Any) -> tuple[int, ...]:
    """Return the motors of an axis: one index, or a list for a gantry."""
    motors = value if isinstance(value, list | tuple) else [value]
    if not motors or not all(type(motor) is int and motor >= 0 for motor in motors):
        raise ValueError("allowed are an index from 0, or a list of them for a gantry")
    if len(set(motors)) < len(motors):
        raise ValueError("names a motor twice")
    return tuple(motors)


def _flags(value: Any) -> tuple[bool, ...]:
    """Return what holds for each motor of an axis: one flag, or a list for a gantry."""
    flags = value if isinstance(value, list | tuple) else [value]
    if not flags or not all(isinstance(flag, bool) for flag in flags):
        raise ValueError("allowed are true and false, or a list of them for a gantry")
    return tuple(flags)


def _upper_keys(value: Any) -> Any:
    return {str(k).upper(): v for k, v in value.items()} if isinstance(value, dict) else value


def _one_of(allowed: Sequence[str]) -> AfterValidator:
    def check(value: str) -> str:
        if value not in allowed:
            raise ValueError(f"allowed are {', '.join(allowed)}")
        return value

    return AfterValidator(check)


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("must not be 0")
    return value


Letter = Annotated[str, _one_of(AXES)]
WorkOffset = Annotated[str, _one_of(WORK_OFFSETS)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NotZero = Annotated[Finite, AfterValidator(_not_zero)]
Scale = Annotated[Fraction, BeforeValidator(_exact)]
Coordinates = Annotated[dict[Letter, Finite], BeforeValidator(_upper_keys)]
Motors = Annotated[tuple[int, ...], BeforeValidator(_motor_tuple)]
Flags = Annotated[tuple[bool, ...], BeforeValidator(_flags)]
Bit = Annotated[int, Field(strict=True, ge=0)]


class _Table(BaseModel):
    """A table of the file: constant, with no keys but its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Axis(_Table):
    """One axis: its drive and its limits [mm or degrees, s]."""

    motors: Motors = Field(alias="motor")
    reversed: Flags = (False,)
    """Whether a motor turns the other way: one for all, or one for each."""
    steps_per_mm: Scale | None = None
    steps_per_degree: Scale | None = None
    min: Finite = -math.inf
    max: Finite = math.inf
    wrapped: Annotated[bool, Field(strict=True)] = False
    """Of a rotary axis: absolute words say where within a turn, and by their sign which way."""
    velocity: Positive
    acceleration: Positive
    jerk: Positive | None = None

    @property
    def jerk_limit(self) -> float:
        """Largest jerk; by default the acceleration is built up in `RISE` seconds.

        A limit so high that it could be built up in less than `LEAST_RISE` counts as that: no
        machine follows it, and a plan gains nothing but pieces too short for the arithmetic.
        """
        if self.jerk is None:
            return self.acceleration / RISE
        return min(self.jerk, self.acceleration / LEAST_RISE)

    @property
    def directions(self) -> tuple[int, ...]:
        """Which way each motor turns while the axis goes forward, 1 or -1."""
        flags = self.reversed * (len(self.motors) if len(self.reversed) == 1 else 1)
        return tuple(-1 if flag else 1 for flag in flags)

    @property
    def steps_per_unit(self) -> Fraction:
        """Motor steps per mm or degree."""
        scale = self.steps_per_mm or self.steps_per_degree
        assert scale is not None  # the machine's validator has seen to it
        return scale


class Kinematics(_Table):
    """How the motors move the axes."""

    type: Literal["cartesian", "corexy"] = "cartesian"


class DriveTiming(_Table):
    """Minimum times that the drives need, from their data sheet [us]."""

    pulse_width_us: NotNegative = 2.5
    pulse_space_us: NotNegative = 2.5
    direction_setup_us: NotNegative = 5.0
    direction_hold_us: NotNegative = 5.0


class PathControl(_Table):
    """How far the path may pass from a programmed corner [mm]."""

    tolerance: NotNegative = 0.01
    exact_tolerance: NotNegative | None = None


class Board(_Table):
    """The motion controller."""

    name: str = "usc"
    profile: str | None = None
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)


class Link(_Table):
    """Where the board is."""

    url: str = "twin:"


class Tool(_Table):
    """One entry of the tool table [mm]."""

    length: Finite = 0.0
    diameter: NotNegative = 0.0


class Outputs(_Table):
    """Bits of the board's digital outputs; None: not wired."""

    spindle: Bit | None = None
    mist: Bit | None = None
    flood: Bit | None = None


class Encoders(_Table):
    """Encoders of the motors, at the board: encoder i is on motor i."""

    counts_per_step: Annotated[tuple[NotZero, ...], Field(min_length=1)]
    following_error: Positive = 2.0
    """So far a motor may be from where it is commanded to be, at rest [step]."""


class Switches(_Table):
    """Limit switches at digital inputs of the board; ``active`` is their level when hit."""

    inputs: Annotated[tuple[Bit, ...], Field(min_length=1)]
    active: Annotated[int, Field(strict=True, ge=0, le=1)] = 1


class Machine(_Table):
    """A machine: axes and limits, drives, board and shop settings.

    Positions are in the columns of `AXES`; an axis the machine does not have stays at its start.

    Examples
    --------
    >>> machine = Machine.default()
    >>> machine.axes, machine.motors, machine.axis["X"].steps_per_unit
    ('XYZA', 4, Fraction(320, 1))
    """

    name: str
    axis: Annotated[dict[Letter, Axis], Field(min_length=1)]
    kinematics: Kinematics = Kinematics()
    drive: DriveTiming = DriveTiming()
    path: PathControl = PathControl()
    board: Board = Board()
    link: Link = Link()
    outputs: Outputs = Outputs()
    encoders: Encoders | None = None
    switches: Switches | None = None
    start: Coordinates = Field(default_factory=dict)
    offsets: dict[WorkOffset, Coordinates] = Field(default_factory=dict)
    tools: dict[Annotated[int, Field(ge=0)], Tool] = Field(default_factory=dict)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a machine file.

        Raises
        ------
        MachineError
            If the file cannot be read or an entry is not usable; the message names the entry, what
            was given and what is allowed.
        """
        try:
            text = Path(path).read_bytes().decode("utf-8-sig")  # some editors begin with a mark
        except OSError as error:
            message = f"cannot read the machine file: {error.strerror}"
            raise MachineError(message, path=path) from error
        except UnicodeDecodeError as error:
            raise MachineError("not a text file in UTF-8, so no machine file", path=path) from error
        return cls.parse(text, path)

    @classmethod
    def parse(cls, text: str, path: Path | str = "") -> Self:
        """Read a machine from the text of a TOML file; ``path`` names it in errors."""
        try:
            return cls.model_validate(tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise MachineError(f"not valid TOML: {error}", path=path) from error
        except ValidationError as error:
            _explain(error, cls, path)

    @classmethod
    def default(cls) -> Self:
        """Return the built-in machine, a small mill with a rotary table."""
        file = resources.files("pulsewright.motion") / "default.toml"
        return cls.parse(file.read_text(encoding="utf-8"), "default.toml")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for letter, axis in self.axis.items():
            unit, other = ("mm", "degree") if letter in LINEAR else ("degree", "mm")
            given = {"mm": axis.steps_per_mm, "degree": axis.steps_per_degree}
            if given[other] is not None or given[unit] is None:
                kind = "linear" if letter in LINEAR else "rotary"
                raise MachineError(
                    f"axis {letter} is {kind} and needs steps_per_{unit}, not steps_per_{other}"
                    if given[other] is not None
                    else f"missing; axis {letter} is {kind} and needs its steps per {unit}",
                    key=f"axis.{letter}.steps_per_{other if given[other] is not None else unit}",
                )
            missing = {"min", "max"} - axis.model_fields_set
            if missing and letter in LINEAR:
                raise MachineError(
                    "missing; this entry is required, only a rotary axis may turn without end",
                    key=f"axis.{letter}.{max(missing)}",
                )
            if axis.wrapped and (letter in LINEAR or len(missing) < 2):
                raise MachineError(
                    "true given; only a rotary axis without min and max can be wrapped",
                    key=f"axis.{letter}.wrapped",
                )
            if len(axis.reversed) not in (1, len(axis.motors)):
                raise MachineError(
                    f"{len(axis.reversed)} flags given for {len(axis.motors)} motors; allowed are "
                    "one for all, or one for each",
                    key=f"axis.{letter}.reversed",
                )
            if axis.min >= axis.max:
                raise MachineError(
                    f"{axis.max:g} given; must be above axis.{letter}.min = {axis.min:g}",
                    key=f"axis.{letter}.max",
                )
        owner: dict[int, str] = {}
        for letter, axis in self.axis.items():
            for motor in axis.motors:
                if motor in owner:
                    raise MachineError(
                        f"motor {motor} is that of axis {owner[motor]} already; each motor "
                        "belongs to one axis",
                        key=f"axis.{letter}.motor",
                    )
                owner[motor] = letter
        if sorted(owner) != list(range(len(owner))):
            free = min(set(range(len(owner))) - set(owner))
            raise MachineError(
                f"motors must be numbered from 0 without gaps; given are {sorted(owner)}, "
                f"{free} is missing",
                key=f"axis.{owner[max(owner)]}.motor",
            )
        for table, coordinates in [("start", self.start)] + [
            (f"offsets.{name}", offset) for name, offset in self.offsets.items()
        ]:
            for letter, value in coordinates.items():
                if letter not in self.axis:
                    raise MachineError(
                        f"the machine has no axis {letter}, only {', '.join(self.axes)}",
                        key=f"{table}.{letter}",
                    )
                if table == "start":
                    axis = self.axis[letter]
                    if not axis.min <= value <= axis.max:
                        raise MachineError(
                            f"{value:g} is outside the travel {axis.min:g}..{axis.max:g}",
                            key=f"start.{letter}",
                        )
        KINEMATICS[self.kinematics.type].matrix(self.axis)
        return self

    @property
    def axes(self) -> str:
        """Letters of the axes, in the order of `AXES`."""
        return "".join(letter for letter in AXES if letter in self.axis)

    @property
    def motors(self) -> int:
        """Number of motors."""
        return sum(len(axis.motors) for axis in self.axis.values())

    @property
    def wrapped(self) -> str:
        """Letters of the wrapped axes."""
        return "".join(letter for letter in self.axes if self.axis[letter].wrapped)

    @property
    def exact_tolerance(self) -> float:
        """Deviation at corners in exact path mode (G61) [mm]."""
        if self.path.exact_tolerance is not None:
            return self.path.exact_tolerance
        return 0.1 / float(max(axis.steps_per_unit for axis in self.axis.values()))

    def start_position(self) -> NDArray[np.float64]:
        """Return the machine position at power on, shape (6,) [mm, degrees]."""
        return self._row(self.start)

    def offset(self, name: WorkOffset) -> NDArray[np.float64]:
        """Return a work offset, shape (6,) [mm, degrees]; 0 where the file gives none."""
        return self._row(self.offsets.get(name, {}))

    def motor_matrix(self) -> NDArray[np.float64]:
        """Return the steps of each motor per mm or degree of each axis, shape (motors, 6)."""
        return KINEMATICS[self.kinematics.type].matrix(self.axis)

    def limit_rows(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return what is limited, and how far.

        Returns
        -------
        rows : (r, 6) float64
            Combinations of axes; here one row per axis, in the order of `axes`.
        velocity, acceleration : (r,) float64
            Largest magnitude along each row [mm/s, degrees/s] and [mm/s^2, degrees/s^2].
        """
        rows = np.array([[float(a == letter) for a in AXES] for letter in self.axes])
        velocity = np.array([self.axis[a].velocity for a in self.axes])
        acceleration = np.array([self.axis[a].acceleration for a in self.axes])
        return rows, velocity, acceleration

    def jerk_limits(self) -> NDArray[np.float64]:
        """Return the largest jerk along each row of `limit_rows`, (r,) [mm/s^3, degrees/s^3]."""
        return np.array([self.axis[a].jerk_limit for a in self.axes])

    def motor_limits(self) -> NDArray[np.float64]:
        """Return the most that each motor does within the limits of the axes.

        Returns
        -------
        (3, motors) float64
            Velocity, acceleration and jerk [step/s, step/s^2, step/s^3].
        """
        rows, velocity, acceleration = self.limit_rows()
        steps = np.abs(self.motor_matrix() @ np.linalg.pinv(rows))  # per unit along each row
        limits: NDArray[np.float64] = (
            np.stack([velocity, acceleration, self.jerk_limits()]) @ steps.T
        )
        return limits

    def check_travel(self, moves: Moves) -> None:
        """Check that every move stays within the travel of every axis.

        Arcs are checked to their true extents, not only at their ends.

        Raises
        ------
        MotionLimitError
            For the first move that leaves the travel or moves an axis that the machine lacks; the
            message names program line, axis, coordinate and limit.
        """
        if not len(moves):
            return
        low, high = move_extents(moves)
        limits = np.stack([moves.start, moves.start])  # axes that are absent stay where they are
        for letter, axis in self.axis.items():
            limits[:, AXES.index(letter)] = axis.min - TRAVEL_MARGIN, axis.max + TRAVEL_MARGIN
        outside = (low < limits[0]) | (high > limits[1])
        if not outside.any():
            return
        move = int(np.argmax(outside.any(axis=1)))
        column = int(np.argmax(outside[move]))
        letter, place = AXES[column], f"line {moves.line[move]}"
        if letter not in self.axis:
            raise MotionLimitError(
                f"{place}: moves axis {letter}, which machine '{self.name}' does not have; only "
                f"{', '.join(self.axes)}; remove the {letter} words or choose another machine"
            )
        axis = self.axis[letter]
        side = "min" if low[move, column] < limits[0, column] else "max"
        value = (low if side == "min" else high)[move, column]
        raise MotionLimitError(
            f"{place}: {letter} reaches {value:.6g} {'mm' if letter in LINEAR else 'degrees'} "
            f"(machine position), beyond axis.{letter}.{side} = {getattr(axis, side):g}; check the "
            "work offset, or choose a machine with more travel"
        )

    def _row(self, coordinates: dict[str, float]) -> NDArray[np.float64]:
        return np.array([coordinates.get(letter, 0.0) for letter in AXES])


def move_extents(moves: Moves) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest coordinate on each move, both (n, 6)."""
    starts = moves.starts()
    low, high = np.minimum(starts, moves.end), np.maximum(starts, moves.end)
    arcs = np.flatnonzero(moves.kind == MoveKind.ARC)
    if len(arcs):
        normal = moves.plane[arcs].astype(int)
        columns = np.stack([normal + 1, normal + 2]) % 3  # first and second axis of the plane
        center = moves.center[arcs, columns]
        arm, far = starts[arcs, columns] - center, moves.end[arcs, columns] - center
        radius = np.maximum(np.hypot(*arm), np.hypot(*far))
        angle, sweep = np.arctan2(arm[1], arm[0]), moves.sweep[arcs]
        begin, size = np.minimum(angle, angle + sweep), np.abs(sweep)
        for quarter in range(4):
            axis, sign = quarter % 2, 1 if quarter < 2 else -1
            there = np.mod(quarter * np.pi / 2 - begin, 2 * np.pi) <= size
            place = arcs[there], columns[axis, there]
            extreme = center[axis, there] + sign * radius[there]
            if sign > 0:
                high[place] = np.maximum(high[place], extreme)
            else:
                low[place] = np.minimum(low[place], extreme)
    return low, high


def _explain(error: ValidationError, model: type[BaseModel], path: Path | str) -> NoReturn:
    """Raise the MachineError that says in the file's own words what pydantic found."""
    details = error.errors(include_url=False)
    details.sort(key=lambda detail: detail["type"] == "missing")  # often a misspelt key's shadow
    (key, message), *others = [_describe(detail, model) for detail in details]
    message += "".join(f"\n  also {other}: {text}" for other, text in others)
    raise MachineError(message, path=path, key=key) from None


def _describe(detail: ErrorDetails, model: type[BaseModel]) -> tuple[str, str]:
    """Return the dotted key of one of pydantic's errors, and what is wrong there."""
    location = [str(part) for part in detail["loc"] if part != "[key]"]
    key, given = ".".join(location), detail["input"]
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, MachineError):
        return cause.key, cause.args[0].removeprefix(f"{cause.key}: ")
    if detail["type"] == "missing":
        return key, "missing; this entry is required"
    if detail["type"] == "extra_forbidden":
        allowed = _keys(model, location[:-1])
        near = difflib.get_close_matches(location[-1], allowed, n=1)
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        return key, f"unknown key{hint}; allowed are {', '.join(allowed)}"
    message = detail["msg"].removeprefix("Value error, ")
    shown = "a table" if isinstance(given, dict) else repr(given)
    return key, f"{shown} given; {message[0].lower()}{message[1:]}"


def _keys(model: type[BaseModel], location: list[str]) -> list[str]:
    """Return the keys that a table of the file may have."""
    for part in location:
        found = next(
            (
                nested
                for name, info in model.model_fields.items()
                if part in (name, info.alias)
                for nested in _models(info.annotation)
            ),
            None,
        )
        model = found or model  # a level such as X in axis.X names an entry, not a table of its own
    return [info.alias or name for name, info in model.model_fields.items()]


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables that a field's type holds."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _models(inner)
