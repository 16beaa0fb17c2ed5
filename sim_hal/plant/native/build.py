"""Machine code of functions that Python calls: made when first needed, kept on disk, called with arrays and ints."""

from __future__ import annotations

import ctypes
import hashlib
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import llvmlite
import numpy as np
from llvmlite import binding, ir

from sim_hal.plant.native.evaluate import Function, signature_of
from sim_hal.plant.native.translate import Translation
from sim_hal.plant.native.values import FLOAT, INT, POINTER, VOID, Array, TranslationError, constant

_SOURCES = Path(__file__).resolve().parents[1]
_NAME = "entry"


class MachineCode:
    """A function in machine code: takes contiguous arrays and ints, returns nothing, lets other threads run."""

    def __init__(self, function: Function) -> None:
        *self._kinds, result = signature_of(function)
        if result != VOID or not all(isinstance(kind, Array) or kind == INT for kind in self._kinds):
            raise TranslationError(
                f"{function.__name__}: Python hands over arrays and ints, and gets nothing"
            )
        address = _loaded(_kept(function), f"{function.__module__}.{function.__name__}")
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(address)
        self._step = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(address)

    def __call__(self, *arguments: Any) -> None:
        self._call(self._words(arguments))

    def bound(self, *arguments: Any) -> Callable[[], None]:
        """The call with arguments that stay: a thirtieth of what handing them over takes.

        It is meant for short steps and holds other threads up: to let them run would cost more than it takes.
        """
        words = self._words(arguments)
        place, call = ctypes.addressof(words), self._step

        def run(_kept: object = (words, arguments)) -> None:
            call(place)

        return run

    def _words(self, arguments: Sequence[Any]) -> ctypes.Array[ctypes.c_int64]:
        """The arguments, one after the other: an array as its place and sizes."""
        words: list[int] = []
        for kind, argument in zip(self._kinds, arguments, strict=True):
            if isinstance(kind, Array):
                words += _words(kind, argument)
            else:
                words.append(argument)
        return (ctypes.c_int64 * len(words))(*words)


def _words(kind: Array, array: np.ndarray[Any, Any]) -> list[int]:
    """Where an array is, and its sizes."""
    right = np.float64 if kind.element == FLOAT else np.int64
    if array.dtype != right or array.ndim != kind.dimensions or not array.flags.c_contiguous:
        raise TypeError(f"needs a contiguous array of {kind.dimensions} dimensions of {right.__name__}")
    try:
        address = ctypes.addressof(
            ctypes.c_char.from_buffer(array.data)
        )  # quick, but not of what is empty or read-only
    except (TypeError, ValueError):
        address = array.ctypes.data
    return [address, *array.shape]


def _machine() -> binding.TargetMachine:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    features = binding.get_host_cpu_features().flatten()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(binding.get_host_cpu_name(), features, opt=2, jit=True)


def _loaded(code: bytes, name: str) -> int:
    """Address of the entry of object code, which stays loaded."""
    module = binding.parse_assembly("")
    engine = binding.create_mcjit_compiler(module, _machine())
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES[name] = engine
    return int(engine.get_function_address(_NAME))


_ENGINES: dict[str, binding.ExecutionEngine] = {}


def translated(function: Function) -> str:
    """LLVM code of a function and all that it calls, with an entry that finds its arguments one after the other."""
    translation = Translation(function.__name__)
    inner = translation.function(function)
    entry = ir.Function(translation.module, ir.FunctionType(VOID, [POINTER]), _NAME)
    b = ir.IRBuilder(entry.append_basic_block())
    arguments = []
    for number, argument in enumerate(inner.args):
        place = b.gep(entry.args[0], [constant(number)], source_etype=INT)
        word = b.load(place, typ=INT)
        arguments.append(b.inttoptr(word, POINTER) if argument.type == POINTER else word)
    b.call(inner, arguments)
    b.ret_void()
    return str(translation.module)


def _compiled(function: Function) -> bytes:
    machine = _machine()
    module = binding.parse_assembly(translated(function))
    module.verify()
    tuning = binding.create_pipeline_tuning_options(speed_level=2)
    # Loops over a handful of states gain nothing from being unrolled, and take twice as long to compile.
    tuning.loop_vectorization = tuning.slp_vectorization = False
    tuning.loop_unrolling = tuning.loop_interleaving = False
    builder = binding.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


def _kept(function: Function) -> bytes:
    """Object code of a function, from disk where it has been made of the same sources for the same processor.

    It lies beside the sources where these may be written, else in the user's cache; what is damaged is made anew.
    """
    folder = _folder()
    path = folder / f"{function.__name__}-{_digest()}.o"
    with suppress(OSError):
        whole = path.read_bytes()
        if hashlib.sha256(whole[32:]).digest() == whole[:32]:
            return whole[32:]
    code = _compiled(function)
    with suppress(OSError):  # kept or not, the code runs
        folder.mkdir(parents=True, exist_ok=True)
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_bytes(hashlib.sha256(code).digest() + code)
        draft.replace(path)
        for other in folder.glob(f"{function.__name__}-*.o") if folder == _beside() else ():
            if other != path:  # of sources that are no more
                other.unlink(missing_ok=True)
    return code


def _beside() -> Path:
    return _SOURCES / "__pycache__"


def _folder() -> Path:
    beside = _beside()
    if os.access(beside if beside.exists() else _SOURCES, os.W_OK):
        return beside
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hopper"


def _digest() -> str:
    """Of all that machine code depends on."""
    digest = hashlib.sha256()
    for path in sorted(_SOURCES.rglob("*.py")):
        digest.update(path.read_bytes())
    for text in (
        llvmlite.__version__,
        binding.get_host_cpu_name(),
        binding.get_host_cpu_features().flatten(),
    ):
        digest.update(text.encode())
    return digest.hexdigest()[:16]
