"""What systemd is told, where it asks to be told."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from hal.raspberry_pi.service_manager import STROKES_A_MESSAGE, ServiceManager


def test_the_manager_hears_that_flight_has_started_lives_and_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ear:
        ear.bind(str(path))
        ear.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        manager = ServiceManager()
        for _ in range(STROKES_A_MESSAGE + 1):
            manager.stroke()
        manager.close()
        manager.close()
        heard = [ear.recv(64) for _ in range(4)]
    assert heard == [b"READY=1", b"WATCHDOG=1", b"WATCHDOG=1", b"STOPPING=1"]


def test_without_a_manager_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    manager = ServiceManager()
    manager.stroke()
    manager.close()


def test_a_manager_that_is_gone_does_not_stop_a_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "nobody"))
    manager = ServiceManager()
    manager.stroke()
    manager.close()
