"""Pico Systems Universal Stepper Controller."""
