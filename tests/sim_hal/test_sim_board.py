"""The simulated board as a whole: repeatable from its seed, breakable on purpose, strict about settings."""

from __future__ import annotations

from typing import Any

import pytest
from sim_helpers import Opener, let_run, settings

from hal.board import open_board as open_by_name
from hal.errors import BoardUnavailable, ConfigError, DeviceError, ReadFailed
from hal.raspberry_pi import open_raspberry_pi
from sim_hal.board import SimBoard, open_sim, world_of


def everything_read(board: SimBoard, read_spring: bool = True) -> dict[str, list[object]]:
    """Tension a little, fire, and read all that the sensors deliver, by sensor."""
    seen: dict[str, list[object]] = {}
    devices = ["nut_encoder", "motor_current", "switches", "accelerometer", "magnet_current"]
    for tick in range(240):
        if tick == 100:
            board.magnet.switch_on()
        let_run(board, 0.005, 4.0)
        for name in [*devices, "spring"] if read_spring else devices:
            seen.setdefault(name, []).append(getattr(board, name).read())
    return seen


def test_one_seed_gives_the_same_bits(open_board: Opener, loaded: Any) -> None:
    first = everything_read(open_board(initial=loaded, seed=7))
    assert everything_read(open_board(initial=loaded, seed=7)) == first


def test_another_seed_gives_other_noise_on_every_noisy_sensor(open_board: Opener, loaded: Any) -> None:
    one = everything_read(open_board(initial=loaded, seed=7))
    other = everything_read(open_board(initial=loaded, seed=8))
    for name in ("motor_current", "spring", "accelerometer", "magnet_current"):
        assert one[name] != other[name], name
    assert one["nut_encoder"] == other["nut_encoder"]  # has no noise
    assert one["switches"] == other["switches"]


def test_not_reading_one_sensor_does_not_shift_another(open_board: Opener, loaded: Any) -> None:
    all_read = everything_read(open_board(initial=loaded))
    without = everything_read(open_board(initial=loaded), read_spring=False)
    assert without == {name: readings for name, readings in all_read.items() if name != "spring"}


def test_noise_substreams_are_not_shared(open_board: Opener) -> None:
    """Accelerometer and magnet current, standardised, have nothing in common."""
    board = open_board()
    board.accelerometer.set_rate_hz(1666.0)
    board.magnet_current.set_rate_hz(1666.0)
    board.accelerometer.read(), board.magnet_current.read()
    let_run(board, 0.25)
    ones = board.accelerometer.read().specific_force_m_s2
    others = board.magnet_current.read().current_a
    mean = sum(ones) / len(ones)
    product = sum((a - mean) / 0.035 * b / 0.005 for a, b in zip(ones, others, strict=True))
    assert abs(product) < 5 * len(ones) ** 0.5


def test_the_encoder_counts_from_power_up(open_board: Opener) -> None:
    board = open_board(initial={"nut_position_m": 0.0123, "latch_closed": False})
    assert board.nut_encoder.read().position_m == 0.0
    let_run(board, 1.0, 6.0)
    travelled = board.world.nut_position_m - 0.0123
    assert board.nut_encoder.read().position_m == pytest.approx(travelled, abs=1.16e-8)


@pytest.mark.parametrize("device", ["nut_encoder", "motor_current", "spring", "accelerometer", "switches"])
def test_a_fault_begins_and_ends_when_it_is_told_to(open_board: Opener, device: str) -> None:
    board = open_board(faults=[{"device": device, "kind": "fail", "from_s": 0.1, "until_s": 0.2}])
    let_run(board, 0.095)
    getattr(board, device).read()
    let_run(board, 0.01)
    with pytest.raises(ReadFailed, match=f"{device}: no answer"):
        getattr(board, device).read()
    let_run(board, 0.11)
    getattr(board, device).read()


def test_a_stuck_encoder_repeats_itself_while_the_nut_runs(open_board: Opener) -> None:
    board = open_board()
    let_run(board, 0.5, 6.0)
    board.faults.plant("nut_encoder", "stick", board.clock.now_s())
    stuck_m = board.nut_encoder.read().position_m
    let_run(board, 0.5, 6.0)
    reading = board.nut_encoder.read()
    assert reading.position_m == stuck_m
    assert reading.time_s == pytest.approx(board.clock.now_s(), abs=0.006)
    assert board.world.nut_position_m > 0.0025 + stuck_m


def test_a_silent_sensor_grows_old(open_board: Opener) -> None:
    board = open_board()
    let_run(board, 0.1)
    for name in ("motor_current", "spring", "switches"):
        board.faults.plant(name, "silent", board.clock.now_s())
    board.spring.read(), board.switches.read()
    let_run(board, 0.3)
    assert board.motor_current.read().time_s < 0.11
    assert board.switches.read().time_s < 0.11
    assert board.spring.read().times_s == ()


def test_a_silent_magnet_fires_nothing(open_board: Opener, loaded: Any) -> None:
    board = open_board(initial=loaded, faults=[{"device": "magnet", "kind": "silent", "from_s": 0.0}])
    board.magnet.switch_on()
    let_run(board, 0.2)
    assert board.world.latch_closed
    assert board.world.spring_compression_m > 0.03


def test_a_stuck_motor_keeps_its_voltage(open_board: Opener) -> None:
    board = open_board()
    let_run(board, 0.3, 6.0)
    board.faults.plant("motor", "stick", board.clock.now_s())
    before_m = board.world.nut_position_m
    let_run(board, 0.3, 0.0)
    assert board.world.nut_position_m > before_m + 2e-4


def test_a_failing_motor_refuses_aloud_and_stays_as_it_was(open_board: Opener) -> None:
    board = open_board()
    board.faults.plant("motor", "fail", 0.0)
    with pytest.raises(DeviceError, match="motor: command not acknowledged"):
        board.motor.set_voltage_v(3.0)
    assert board.world.voltage_v == 0.0


def test_the_loopback_link_carries_both_ways(open_board: Opener) -> None:
    board = open_board(ground_link={"depth": 2})
    let_run(board, 0.05)
    board.link.command("tension", {"energy_j": 18.0})
    (command,) = board.ground_link.receive()
    assert (command.name, command.arguments) == ("tension", (("energy_j", 18.0),))
    assert command.time_s == board.clock.now_s()
    assert board.ground_link.receive() == ()
    for number in range(3):
        board.ground_link.send("state", str(number))
    assert [payload for _, _, payload in board.link.telemetry] == ["1", "2"]


def test_it_is_opened_by_its_name_only(open_board: Opener) -> None:
    board = open_by_name("sim", settings())
    assert world_of(board).hops == []
    board.close()
    with pytest.raises(BoardUnavailable):
        open_raspberry_pi({})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seed": -1}, r"seed = -1 is outside its limits"),
        ({"seeds": 1}, "unknown key seeds"),
        ({"spots": []}, "spots must name at least one ground"),
        (
            {"spots": [{"surface": "steel", "foot": 7}]},
            r"spots\[0\]\.foot = 7 is outside its limits \[0, 4\]",
        ),
        ({"spots": [{"surface": "cheese"}]}, r"spots\[0\]\.surface = 'cheese' .* known there: steel, syar"),
        ({"initial": {"nut_position_m": 0.1}}, r"initial\.nut_position_m = 0\.1 is outside the end stops"),
        ({"rig": {"stop_low_m": -0.0005}}, r"rig\.stop_low_m = -0\.0005 must lie below"),
        ({"watchdog": {"timeout_s": float("nan")}}, r"watchdog\.timeout_s = nan must be finite"),
        ({"motor": {"max_voltage_v": "12"}}, r"motor\.max_voltage_v = '12' must be a number"),
        (
            {"plants": {"hop": "plant/bb0b_drive.yaml"}},
            r"plants\.hop = 'plant/bb0b_drive\.yaml' is a plant of",
        ),
        ({"plants": {"hop": "plant/none.yaml"}}, "none.yaml: no such configuration file"),
        ({"faults": [{"device": "nose", "kind": "fail", "from_s": 0.0}]}, "device = 'nose' is unknown"),
        ({"faults": [{"device": "spring", "kind": "sulk", "from_s": 0.0}]}, "kind = 'sulk' is unknown"),
    ],
)
def test_bad_settings_are_refused_in_words(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        open_sim(settings(**changes))
