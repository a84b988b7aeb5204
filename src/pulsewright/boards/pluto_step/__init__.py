"""Pluto-P with four step generators behind a parallel port."""
