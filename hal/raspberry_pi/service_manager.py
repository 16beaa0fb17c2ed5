"""Tells systemd that the flight software has started and is alive (sd_notify(3)), where it asks to be told."""

from __future__ import annotations

import os
import socket
from contextlib import suppress

STROKES_A_MESSAGE = 20
"""The manager counts in seconds; ten messages a second are enough."""


class ServiceManager:
    """The socket named by NOTIFY_SOCKET, if there is one. Nothing here can fail a flight."""

    def __init__(self) -> None:
        path = os.environ.get("NOTIFY_SOCKET", "")
        # a leading @ stands for a name in the abstract namespace
        self._address = "\0" + path[1:] if path.startswith("@") else path
        self._socket = (
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if path else None
        )
        self._strokes = 0

    def stroke(self) -> None:
        """The software is alive; the first time, that it has started."""
        if self._strokes == 0:
            self._tell(b"READY=1")
        if self._strokes % STROKES_A_MESSAGE == 0:
            self._tell(b"WATCHDOG=1")
        self._strokes += 1

    def close(self) -> None:
        """Tell nothing any more. May be called again."""
        if self._socket is not None:
            self._tell(b"STOPPING=1")
            self._socket.close()
        self._socket = None

    def _tell(self, message: bytes) -> None:
        if self._socket is None:
            return
        with suppress(OSError):  # a manager that is busy or gone must not stop a flight that goes well
            self._socket.sendto(message, self._address)
