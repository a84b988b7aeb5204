"""Settings of PLLs that give a clock exactly, and no others."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Final, Literal

from pulsewright.errors import UsageError

Family = Literal["ice40", "ecp5"]

# Limits of the data sheets [Hz].
_ICE40_PFD: Final = (10_000_000, 133_000_000)
_ICE40_VCO: Final = (533_000_000, 1_066_000_000)
_ICE40_OUT: Final = (16_000_000, 275_000_000)
_ECP5_PFD: Final = (3_125_000, 400_000_000)
_ECP5_VCO: Final = (400_000_000, 800_000_000)
# FILTER_RANGE of the iCE40 by the frequency of the phase detector: the first that is above it [Hz].
_ICE40_FILTER: Final = (17_000_000, 26_000_000, 44_000_000, 66_000_000, 101_000_000)
_RING: Final = 8  # longest divider behind an iCE40 PLL


@dataclass(frozen=True)
class Pll:
    """How a clock is made: ``reference_hz / reference * feedback / ring``.

    Parameters
    ----------
    family : str
        ``ice40`` (SB_PLL40) or ``ecp5`` (EHXPLLL).
    reference_hz : int
        Clock of the board [Hz].
    reference : int
        Divider in front of the phase detector.
    multiplier : int
        Divider of the feedback. The ECP5 feeds back its output, the iCE40 the oscillator itself.
    output : int
        Divider between oscillator and output.
    ring : int
        Divider in logic behind the PLL; 1 for none.
    second : int
        ECP5: divider between oscillator and a second output, which is the one used; 0 for none.
    """

    family: Family
    reference_hz: int
    reference: int
    multiplier: int
    output: int
    ring: int = 1
    second: int = 0

    @property
    def detector_hz(self) -> Fraction:
        """Frequency of the phase detector [Hz]."""
        return Fraction(self.reference_hz, self.reference)

    @property
    def oscillator_hz(self) -> Fraction:
        """Frequency of the oscillator [Hz]."""
        divided = self.output if self.family == "ecp5" else 1
        return self.detector_hz * self.multiplier * divided

    @property
    def output_hz(self) -> Fraction:
        """Frequency of the PLL [Hz]."""
        return self.oscillator_hz / (self.second or self.output)

    @property
    def clock_hz(self) -> Fraction:
        """Frequency of the clock that is made [Hz]."""
        return self.output_hz / self.ring

    @property
    def filter_range(self) -> int:
        """FILTER_RANGE of an iCE40 PLL."""
        return 1 + sum(self.detector_hz >= limit for limit in _ICE40_FILTER)

    def __str__(self) -> str:
        """Return the arithmetic: ``12 MHz x 80 / 8 / 3 = 40 MHz``."""
        text = f"{_mhz(self.reference_hz)}"
        if self.reference > 1:
            text += f" / {self.reference}"
        if self.second:
            text += f" x {self.multiplier * self.output} / {self.second}"
        else:
            text += f" x {self.multiplier}"
        if self.family == "ice40":
            text += f" / {self.output}"
        if self.ring > 1:
            text += f" / {self.ring}"
        return f"{text} = {_mhz(self.clock_hz)}"


def solve(family: Family, reference_hz: int, clock_hz: int) -> Pll:
    """Return settings that make ``clock_hz`` exactly.

    An iCE40 PLL cannot make 40 MHz from 12 MHz, but 120 MHz: there a ring of flip-flops divides
    what the PLL gives. The shortest ring is taken, and the smallest reference divider.

    Raises
    ------
    UsageError
        If no setting is exact.

    Examples
    --------
    >>> print(solve("ice40", 12_000_000, 40_000_000))
    12 MHz x 80 / 8 / 3 = 40 MHz
    """
    found = (_ice40 if family == "ice40" else _ecp5)(reference_hz, clock_hz)
    if found is None:
        raise UsageError(
            f"the PLL of the {family} cannot make {_mhz(clock_hz)} exactly from "
            f"{_mhz(reference_hz)}; choose a platform with another crystal"
        )
    return found


def _ice40(reference_hz: int, clock_hz: int) -> Pll | None:
    for ring in range(1, _RING + 1):
        for reference in range(1, 17):
            for output in (2, 4, 8, 16, 32, 64):
                multiplier = Fraction(clock_hz * ring * output * reference, reference_hz)
                if multiplier.denominator != 1 or not 1 <= multiplier <= 128:
                    continue
                pll = Pll("ice40", reference_hz, reference, int(multiplier), output, ring)
                if (
                    _within(pll.detector_hz, _ICE40_PFD)
                    and _within(pll.oscillator_hz, _ICE40_VCO)
                    and _within(pll.output_hz, _ICE40_OUT)
                ):
                    return pll
    return None


def _ecp5(reference_hz: int, clock_hz: int) -> Pll | None:
    middle = sum(_ECP5_VCO) // 2
    output = min(range(1, 129), key=lambda n: abs(n * clock_hz - middle))
    for reference in range(1, 129):
        multiplier = Fraction(clock_hz * reference, reference_hz)
        if multiplier.denominator != 1 or not 1 <= multiplier <= 80:
            continue
        pll = Pll("ecp5", reference_hz, reference, int(multiplier), output)
        if _within(pll.detector_hz, _ECP5_PFD) and _within(pll.oscillator_hz, _ECP5_VCO):
            return pll
    # A second output, which is not fed back, can have a fraction of the oscillator.
    references = range(1, reference_hz // _ECP5_PFD[0] + 1)
    for reference, feedback, output in product(references, range(1, 81), range(1, 129)):
        oscillator = Fraction(reference_hz * feedback * output, reference)
        second = oscillator / clock_hz
        if _within(oscillator, _ECP5_VCO) and second.denominator == 1 and second <= 128:
            return Pll("ecp5", reference_hz, reference, feedback, output, second=int(second))
    return None


def _within(value: Fraction, limits: tuple[int, int]) -> bool:
    return limits[0] <= value <= limits[1]


def _mhz(frequency: int | Fraction) -> str:
    return f"{float(frequency) / 1e6:.9g} MHz"
