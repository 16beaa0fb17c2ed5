"""The generator of blind cases: repeatable, complete, and silent to the diagnosis about what it hides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.cases import KINDS, VISIBLE, BlindCase, draw_case, nominal_plant, within_tolerances
from benchmarks.blind.excite import runs_of
from benchmarks.blind.explanations import OUT_OF_TOLERANCE, drawn, explanations, shaped, typical_scales
from benchmarks.blind.sight import Sight, channel_sigmas, mask, simulate
from sim_hal.plant.simulate import catalogue

QUICK = [("axis", number) for number in range(12)] + [("drop", number) for number in range(6)]


@pytest.fixture(scope="module")
def cases() -> dict[tuple[str, int], BlindCase]:
    return {(kind, number): draw_case(kind, number, seed=5) for kind, number in QUICK}


def some(cases: dict[tuple[str, int], BlindCase], count: int) -> list[BlindCase]:
    """The cases with this many things hidden; the seed has some of each."""
    found = [case for case in cases.values() if len(case.hidden) == count]
    assert found
    return found


def test_a_case_is_the_same_to_the_bit_whenever_it_is_drawn(cases: dict[tuple[str, int], BlindCase]) -> None:
    again = draw_case("axis", 3, seed=5)
    assert again.hidden == cases["axis", 3].hidden
    for one, other in zip(
        again.train + again.test, cases["axis", 3].train + cases["axis", 3].test, strict=True
    ):
        assert one.same_content(other)
    other_seed = draw_case("axis", 3, seed=6)
    assert not other_seed.train[0].same_content(again.train[0])


def test_nothing_is_hidden_in_a_null_case(cases: dict[tuple[str, int], BlindCase]) -> None:
    for case in some(cases, 0):
        assert case.truth.effects == ()
        for name, parameter in case.truth.flat().items():
            stated = case.plant.flat()[name]
            assert abs(parameter.value - stated.value) <= 2.0 * stated.std + 1e-12
        chi = residuals(case)
        assert np.all(np.abs(chi - 1.0) < 0.1)


def residuals(case: BlindCase) -> np.ndarray:
    """Reduced residual of the truth by channel over the test runs."""
    sigmas = np.array(list(channel_sigmas(case.plant).values()))
    rows = []
    for run, table in zip(case.test, case.clean, strict=True):
        read = np.column_stack([run.channels[name] for name in case.plant.structure.outputs])
        rows.append(((read - table) / sigmas)[mask(case.truth, run)])
    return np.sqrt(np.mean(np.vstack(rows) ** 2, axis=0))


def test_what_is_hidden_is_in_the_truth_and_shows(cases: dict[tuple[str, int], BlindCase]) -> None:
    for case in some(cases, 1) + some(cases, 2):
        planted = {use.physics_id for use in case.truth.effects}
        for one in case.hidden:
            assert one.visible > 0.7 * VISIBLE[0]
            if one.physics_id == OUT_OF_TOLERANCE:
                stated = case.plant.flat()[str(one.place)]
                assert abs(one.parameters[str(one.place)] - stated.value) > 3.0 * stated.std
            else:
                assert one.physics_id in planted


def test_the_recordings_do_not_give_the_secret_away(cases: dict[tuple[str, int], BlindCase]) -> None:
    for case in cases.values():
        assert case.plant.effects == ()
        for run in case.train:
            said = f"{run.run} {run.rig} {run.notes} {dict(run.conditions)} {dict(run.state)} {run.events}"
            assert run.source is None
            assert not any(name in said for name in (*catalogue(), OUT_OF_TOLERANCE))
            assert set(run.channels) == {*case.plant.structure.inputs, *case.plant.structure.outputs}


def test_readings_are_rounded_and_limited_as_the_sensors_are(cases: dict[tuple[str, int], BlindCase]) -> None:
    for case in cases.values():
        for name, sensor in case.plant.sensors.items():
            values = case.train[0].channels[name]
            assert sensor.resolution is not None
            assert np.allclose(values / sensor.resolution, np.round(values / sensor.resolution), atol=1e-6)


def test_every_effect_that_can_act_somewhere_is_drawn() -> None:
    random = np.random.default_rng(0)
    offered, seen = set[str](), set[str]()
    for kind in KINDS:
        plant = nominal_plant(kind)
        runs = runs_of(plant, 2, random)
        options = explanations(plant, runs)
        scales = typical_scales(plant, [short(run) for run in runs])
        offered |= {option.physics_id for option in options}
        for option in (drawn(options, random) for _ in range(600)):
            if shaped(option, plant, scales, random) is not None:
                seen.add(option.physics_id)
    assert set(catalogue()) <= offered
    assert offered == seen


def short(run):  # type: ignore[no-untyped-def]
    """The first tenth of a run, enough for typical sizes."""
    count = run.times_s.size // 10
    channels = {name: values[:count] for name, values in run.channels.items()}
    return replace(run, times_s=run.times_s[:count], channels=channels)


def test_what_the_own_parameters_take_up_does_not_show() -> None:
    random = np.random.default_rng(3)
    nominal = nominal_plant("axis")
    runs = runs_of(nominal, 2, random)
    own = within_tolerances(nominal, runs, random)
    sight = Sight(own, runs, nominal)
    heavier = own.with_values({"m": own.flat()["m"].value + 0.1 * nominal.flat()["m"].std})
    change = sight.scaled(heavier) - sight.base
    assert np.sqrt(np.mean(change**2)) > 1.0
    assert sight.seen(change).most < 0.05 * np.sqrt(np.mean(change**2))
    assert sight.seen(change, without="m").most > 1.0


def test_a_hop_case_flies_and_lands() -> None:
    case = draw_case("hop", 2, seed=5)
    assert 4 <= len(case.train) <= 6
    assert len(case.test) == 2
    assert {run.conditions["place"] for run in case.train} == {"A", "B"}
    for run in case.train:
        assert 0.3 < mask(case.truth, run).mean() < 1.0
    assert len(simulate(case.truth, case.test)) == 2
