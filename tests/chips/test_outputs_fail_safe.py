"""Outputs are off on open, close, exception, signal and exit; and the magnet keeps to peak and hold."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from chip_helpers import Opener, opened, run_ticks

from hal.errors import BoardUnavailable, ConfigError, DeviceError, NoAcknowledge
from sim_hal.chips.board import EmulatedBoard
from sim_hal.chips.bridge import MockPins, PwmTree

CHILD = """
import atexit, signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job starts with it ignored
sys.path.insert(0, {helpers!r})
board = None
def tell():  # registered first, so that it runs after everything else
    rig = board.rig
    Path({out!r}).write_text(f"{{rig.outputs_off}} {{before}}")
atexit.register(tell)
from chip_helpers import opened, run_ticks
board = opened()
run_ticks(board, 3, 6.0)
board.magnet.switch_on()
before = not board.rig.outputs_off
print("running", flush=True)
{end}
"""

ENDS = {
    "SIGTERM": "import time; time.sleep(60)",
    "SIGHUP": "import time; time.sleep(60)",
    "SIGINT": "import time; time.sleep(60)",
    "exception": "raise RuntimeError('flight software at fault')",
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, int]]:
    """For each way to end: what a program with motor and magnet on says of its outputs at last, and its exit code.

    All at once, because each takes seconds to start.
    """
    folder = tmp_path_factory.mktemp("children")
    children = {}
    for how, end in ENDS.items():
        program = CHILD.format(helpers=str(Path(__file__).parent), out=str(folder / how), end=end)
        children[how] = subprocess.Popen(
            [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
    found = {}
    for how, child in children.items():
        with child:
            assert child.stdout is not None
            assert child.stdout.readline() == "running\n"
            if how.startswith("SIG"):
                child.send_signal(getattr(signal, how))
            code = child.wait(60)
        found[how] = ((folder / how).read_text(), code)
    return found


@pytest.mark.parametrize("how", ENDS)
def test_however_a_program_ends_it_switches_off(ended: dict[str, tuple[str, int]], how: str) -> None:
    said, code = ended[how]
    assert said == "True True"
    assert code != 0


def test_software_that_dies_without_a_word_is_switched_off_from_outside(board: EmulatedBoard) -> None:
    """SIGKILL: nothing is closed, no handler runs, only time passes."""
    run_ticks(board, 20, 6.0)
    board.magnet.switch_on()
    run_ticks(board, 4)
    assert board.rig.world.magnet_on
    board.rig.advance(board.rig.now_s + board.watchdog.timeout_s + 1e-6)
    assert not board.rig.world.magnet_on
    assert board.rig.world.voltage_v == 0.0
    board.rig.advance(board.rig.now_s + 2.0)
    assert board.chips.watchdogs[0].has_reset


def test_nothing_has_power_before_the_first_stroke(board: EmulatedBoard) -> None:
    board.magnet.switch_on()
    board.motor.set_voltage_v(6.0)
    board.clock.sleep_until_s(0.05)
    assert not board.rig.supply_on
    assert not board.rig.world.magnet_on


def test_outputs_left_on_by_a_dead_program_are_off_after_opening(
    open_board: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel keeps a PWM as it was when its user dies."""
    make = PwmTree.__init__

    def left_on(self: PwmTree, root: Path, chip: int, channels: int) -> None:
        make(self, root, chip, channels)
        for path, value in (
            ("export", "0"),
            ("pwm0/period", "50000"),
            ("pwm0/duty_cycle", "9"),
            ("pwm0/enable", "1"),
        ):
            self.write(f"class/pwm/pwmchip0/{path}", value)

    monkeypatch.setattr(PwmTree, "__init__", left_on)
    board = open_board()
    assert board.chips.sysfs.duty(0) == 0.0
    assert board.rig.outputs_off


def test_an_opening_that_fails_half_way_leaves_nothing_on(monkeypatch: pytest.MonkeyPatch) -> None:
    trees: list[PwmTree] = []
    make = PwmTree.__init__

    def kept(self: PwmTree, root: Path, chip: int, channels: int) -> None:
        make(self, root, chip, channels)
        trees.append(self)

    monkeypatch.setattr(PwmTree, "__init__", kept)
    with pytest.raises(NoAcknowledge, match="spring"):
        opened(wire_faults=[{"device": "spring", "kind": "nack", "from_s": 0.0}])
    assert not trees[0].exists("class/pwm/pwmchip0/pwm0/duty_cycle")  # closed, and its folder gone
    handler = signal.getsignal(signal.SIGTERM)
    assert (
        handler in (signal.SIG_DFL, None) or getattr(handler, "__module__", "") != "hal.raspberry_pi.failsafe"
    )


def test_a_pin_that_is_in_use_makes_the_board_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        MockPins, "claim_input", lambda self, pin: self._refuse_if_taken(pin) or self.claim_output(22, False)
    )
    with pytest.raises(BoardUnavailable, match="pin 22 is in use"):
        opened()


def test_the_magnet_has_full_supply_first_and_is_then_held(board: EmulatedBoard) -> None:
    run_ticks(board, 1)
    board.magnet.switch_on()
    duty = board.chips.sysfs.duty
    assert duty(0) == 1.0
    run_ticks(board, 29)
    assert duty(0) == 1.0
    run_ticks(board, 2)
    assert duty(0) == pytest.approx(0.4)
    board.magnet.switch_off()
    assert duty(0) == 0.0


def test_a_magnet_that_was_switched_off_is_not_held(board: EmulatedBoard) -> None:
    run_ticks(board, 1)
    board.magnet.switch_on()
    run_ticks(board, 4)
    board.magnet.switch_off()
    run_ticks(board, 40)
    assert board.chips.sysfs.duty(0) == 0.0


def test_a_magnet_that_draws_too_little_is_told_after_it_was_obeyed(open_board: Opener) -> None:
    board = open_board(wiring={"magnet": {"min_current_a": 2.5}})
    run_ticks(board, 1)
    board.magnet.switch_on()
    run_ticks(board, 35)
    with pytest.raises(DeviceError, match=r"magnet: its current was 1\.\d+ A at full supply, 2.5 A are due"):
        board.magnet.switch_off()
    assert board.chips.sysfs.duty(0) == 0.0
    board.magnet.switch_off()


@pytest.mark.parametrize(
    ("wiring", "says"),
    [
        ({"spring": {"address": 0x41}}, "both at I2C bus 3 address 0x41"),
        ({"switches": {"home_pin": 22}}, "both at pin 22"),
        ({"motor": {"stage": "servo"}}, "motor.stage = 'servo' is unknown"),
        ({"motor": {"roboclaw": None}}, "needs the block motor.roboclaw"),
        ({"motor": {"sign": 0}}, "motor.sign = 0 must be 1 or -1"),
        ({"motor": {"supply_min_v": 15.0}}, "is above supply_max_v"),
        ({"accelerometer": {"axis": "w"}}, "accelerometer.axis = 'w' is unknown"),
        ({"accelerometer": {"bus": 99}}, "accelerometer.bus = 99 is outside its limits"),
        ({"watchdog": {"timeout_s": 0.2}}, "is not 0.1, that of the simulation"),
        ({"spring": {"rates_hz": []}}, "spring.rates_hz must name at least one rate"),
        ({"motor_current": {"max_current_a": 1e-9}}, "gives calibration"),
        ({"spring": {"full_scale_v": 3.3}}, "full_scale_v = 3.3 is none of the part's"),
    ],
)
def test_a_wiring_that_cannot_be_is_refused(wiring: dict[str, object], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        opened(wiring=wiring)
