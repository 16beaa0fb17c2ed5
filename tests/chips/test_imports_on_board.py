"""What flies imports only what a Raspberry Pi is given."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import sys, pkgutil, importlib
import flight, hal
for package in (flight, hal):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
print("\\n".join(sorted({name.partition(".")[0] for name in sys.modules})))
"""

GIVEN = {"numpy", "yaml", "_yaml", "serial", "smbus2", "mcap", "lgpio", "flight", "hal"} | {
    "lz4",  # these two are what mcap itself depends on
    "zstandard",
    "cython_runtime",  # no package: part of compiled modules
}
"""The dependencies of the wheel and of its extra `rpi`, as they are called when imported."""


def test_all_of_flight_and_hal_import_nothing_but_what_is_on_board() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    found = set(done.stdout.split())
    assert {"flight", "hal", "numpy", "yaml", "serial", "smbus2"} <= found
    foreign = {
        name
        for name in found - GIVEN - set(sys.stdlib_module_names)
        if not name.startswith(("_", "flight_machine_code"))
    }
    assert foreign == set()
