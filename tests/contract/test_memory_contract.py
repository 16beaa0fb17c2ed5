"""What the memory of every backend keeps to: the simulation's forgets with the process, the robot's is a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from hal.devices import Memory
from hal.errors import DeviceClosed, DeviceError, ReadFailed
from hal.memory import FileMemory, VolatileMemory

pytestmark = [pytest.mark.device("memory"), pytest.mark.parametrize("backend", ["sim", "drivers"])]


@pytest.fixture
def memory(backend: str, tmp_path: Path) -> Memory:
    return VolatileMemory() if backend == "sim" else FileMemory(tmp_path / "record")


def test_before_the_first_record_there_is_none(memory: Memory) -> None:
    assert memory.read() == ""


@pytest.mark.parametrize("text", ["", '{"loaded": true}', "zwei\nZeilen, Ähre", "x" * 100_000])
def test_the_newest_record_comes_back_as_it_was(memory: Memory, text: str) -> None:
    memory.write("older")
    memory.write(text)
    assert memory.read() == text
    assert memory.read() == text


def test_closed_it_says_so(memory: Memory) -> None:
    memory.write("kept")
    memory.close()
    memory.close()
    with pytest.raises(DeviceClosed, match="memory"):
        memory.read()
    with pytest.raises(DeviceClosed, match="memory"):
        memory.write("more")


def test_on_file_it_outlives_the_process_and_is_never_half(backend: str, tmp_path: Path) -> None:
    if backend == "sim":
        pytest.skip("forgets with the process, and is meant to")
    path = tmp_path / "record"
    FileMemory(path).write("kept over a restart")
    assert FileMemory(path).read() == "kept over a restart"
    whole = path.read_bytes()
    for keep in range(1, len(whole)):
        path.write_bytes(whole[:keep])
        with pytest.raises(ReadFailed, match="record is damaged"):
            FileMemory(path).read()
    with pytest.raises(DeviceError, match="cannot be written"):
        FileMemory(tmp_path / "nowhere" / "record").write("lost")
