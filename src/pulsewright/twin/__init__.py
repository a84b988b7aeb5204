"""Blocks that the twins of several boards share."""
