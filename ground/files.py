"""Writing files so that a reader never meets half of one."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def write_atomic(path: Path, content: str | bytes) -> Path:
    """Write `content` (text as UTF-8) to `path`, whole or not at all; folders are made as needed.

    The content goes to a hidden neighbour first, which then takes the name in one step. Returns `path`.
    Raises `OSError` when the place cannot be written; the neighbour is then removed and `path` is untouched.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        part.chmod(0o644)  # mkstemp keeps files private; a result is meant to be read
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path
