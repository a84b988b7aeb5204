"""Network addresses as links and servers are given them."""

from __future__ import annotations


def host_and_port(place: str) -> tuple[str, int] | None:
    """Read ``HOST:PORT``, with a port of 0..65535; None if it is not that.

    Examples
    --------
    >>> host_and_port("[::1]:5000")
    ('::1', 5000)
    """
    host, _, port = place.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal() or int(port) > 65535:
        return None
    return host, int(port)
