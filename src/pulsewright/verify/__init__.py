"""Decide from the recorded step edges alone what a machine did, and whether it kept its limits."""

from pulsewright.verify.reference import Tolerances
from pulsewright.verify.verdict import Check, MotorSummary, PathSample, Verdict
from pulsewright.verify.verifier import Verifier

__all__ = ["Check", "MotorSummary", "PathSample", "Tolerances", "Verdict", "Verifier"]
