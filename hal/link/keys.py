"""The key that signs commands: a file that nobody but its owner can read."""

from __future__ import annotations

import os
import secrets
import stat
from pathlib import Path

from hal.errors import ConfigError

KEY_BYTES = 32


class Key:
    """A secret that does not show itself: its text is never that of its bytes."""

    def __init__(self, secret: bytes) -> None:
        if len(secret) < KEY_BYTES:
            raise ConfigError(f"a key of {len(secret)} bytes is too short; it needs {KEY_BYTES}")
        self._secret = secret

    @property
    def secret(self) -> bytes:
        """The bytes, for signing only."""
        return self._secret

    def __repr__(self) -> str:
        return "Key(...)"

    def __reduce__(self) -> str:
        raise TypeError("a key is not to be stored or sent")


def load_key(path: Path) -> Key:
    """Read a key (hexadecimal). Raises `ConfigError` naming the file when others can read it, or it is none."""
    try:
        with path.open("rb") as stream:
            mode = os.fstat(stream.fileno()).st_mode
            text = stream.read(1024)
    except OSError as error:
        raise ConfigError(f"{path}: the key cannot be read ({error.strerror})") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(
            f"{path}: permissions {stat.S_IMODE(mode):04o} let others at the key; they must be 0600 at most"
        )
    try:
        secret = bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        raise ConfigError(f"{path}: is no key ({2 * KEY_BYTES} hexadecimal digits)") from None
    if len(secret) != KEY_BYTES:
        raise ConfigError(f"{path}: a key of {len(secret)} bytes; it must have {KEY_BYTES}")
    return Key(secret)


def make_key(path: Path) -> None:
    """Write a new key that only its owner can read. Raises `ConfigError` when the file exists."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise ConfigError(f"{path}: the key cannot be written ({error.strerror})") from error
    with os.fdopen(handle, "w", encoding="ascii") as stream:
        stream.write(secrets.token_hex(KEY_BYTES) + "\n")
