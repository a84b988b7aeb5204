"""Amaranth blocks that the boards share, and the engine that runs gateware at speed."""
