"""The drivers on a real kernel: Debian's arm64 kernel on an emulated computer (QEMU, machine `virt`).

`make test-kernel` fetches what this needs; without it the test is skipped. The motor controller at the end of the
serial line is a few lines here: its own tests are in `tests/chips`.
"""

from __future__ import annotations

import os
import shutil
import socket
import struct
import subprocess
import threading
from binascii import crc_hqx
from pathlib import Path

import pytest

FOLDER = Path(os.environ.get("HOPPER_ARM64", Path(__file__).resolve().parents[2] / "out" / "arm64"))
QEMU = "qemu-system-aarch64"
LONGEST_S = 900.0


def why_not() -> str:
    """What is lacking, in words; empty when the computer can be started."""
    if shutil.which(QEMU) is None:
        return f"{QEMU} is not installed: make test-kernel"
    if not (FOLDER / "initramfs.gz").is_file():
        return f"{FOLDER} is not prepared: make test-kernel"
    return ""


def crc(data: bytes) -> bytes:
    return struct.pack(">H", crc_hqx(data, 0))


def answer(packet: bytes) -> bytes:
    """What a RoboClaw with a count of -4711 and 12.0 V says to a packet."""
    data = {15: b"\x01", 16: struct.pack(">iB", -4711, 0), 21: b"RoboClaw 2x7a v4.1.34\n\0", 24: b"\x00\x78"}
    if packet[1] in data:
        return data[packet[1]] + crc(packet + data[packet[1]])
    return b"\xff" if crc(packet[:-2]) == packet[-2:] else b""


def serve(listener: socket.socket) -> None:
    """Answer packets until the computer is gone; the driver waits for each answer, so a pause ends a packet."""
    with listener.accept()[0] as line:
        line.settimeout(0.3)
        packet = b""
        while True:
            try:
                received = line.recv(64)
            except TimeoutError:
                if packet:
                    line.sendall(answer(packet))
                packet = b""
                continue
            if not received:
                return
            packet += received


@pytest.mark.skipif(bool(why_not()), reason=why_not())
def test_the_drivers_on_the_kernel_s_own_devices(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "line"))
        listener.listen()
        thread = threading.Thread(target=serve, args=(listener,), daemon=True)
        thread.start()
        done = subprocess.run(
            [
                *(QEMU, "-machine", "virt", "-cpu", "cortex-a72", "-m", "1024", "-nographic", "-no-reboot"),
                *("-kernel", str(FOLDER / "vmlinuz"), "-initrd", str(FOLDER / "initramfs.gz")),
                *("-append", "console=ttyAMA0 panic=-1 quiet", "-net", "none"),
                *(
                    "-chardev",
                    f"socket,id=line,path={tmp_path / 'line'}",
                    "-device",
                    "pci-serial,chardev=line",
                ),
            ],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        thread.join(10.0)
    print(done.stdout)
    assert "CHECKS 8 of 8 good" in done.stdout
    # a computer whose flight software is silent is reset by its watchdog
    after = done.stdout.partition("STARVING")[2]
    assert "softdog: Initiating system reboot" in after
    assert "STILL ALIVE" not in after
