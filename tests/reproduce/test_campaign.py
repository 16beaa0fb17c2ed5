"""The published campaign: its plan, its flight, and what is said of the published numbers."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from flight.settings import load
from ground.reproduce.chain import through_chain
from ground.reproduce.command import (
    Campaign,
    compared,
    configured_campaign,
    content,
    reproduce_by_flight,
    write_results,
)
from ground.reproduce.disagreements import disagreements
from ground.reproduce.fly import FlownHop, campaign_runs, drawn_missions, fly_campaign
from ground.reproduce.mechanism import Mechanisms
from ground.reproduce.moon import moon_height_m
from ground.reproduce.page import verdict
from ground.reproduce.paper import load_paper
from ground.reproduce.plan import load_campaign
from hal.config import config_path
from hal.errors import ConfigError

PAPER = load_paper()


def silent(text: str, done: float | None = None) -> None:
    """Progress that nobody watches."""


def small_campaign(*names: str) -> Campaign:
    """Some of the set-ups."""
    campaign = configured_campaign()
    setups = tuple(setup for setup in campaign.plan.setups if setup.name in names)
    return replace(campaign, plan=replace(campaign.plan, setups=setups))


@pytest.fixture(scope="module")
def sand() -> tuple[Campaign, list[FlownHop]]:
    """A reference jump, a probe and a test on sand, flown."""
    campaign = small_campaign("sand-2")
    return campaign, fly_campaign(campaign.missions(3), campaign.settings, silent)


def test_the_plan_has_the_published_numbers_of_runs() -> None:
    plan = load_campaign(PAPER)
    tests = [(test.surface, setup.foot, test.tilt_deg) for setup in plan.setups for test in setup.tests]
    assert len(plan.setups) == PAPER.campaign.references == 20
    assert len(tests) + len(plan.setups) == PAPER.campaign.accepted == 54
    assert Counter(tests) == {row.key: row.runs for row in PAPER.surfaces}
    by_foot = Counter(setup.foot for setup in plan.setups) + Counter(foot for _, foot, _ in tests)
    assert by_foot == {name: foot.c1.runs for name, foot in PAPER.feet.items()}
    low, high = PAPER.campaign.spring_energy_j.low, PAPER.campaign.spring_energy_j.high
    energies = [test.energy_j for setup in plan.setups for test in setup.tests]
    energies += [setup.reference_energy_j for setup in plan.setups]
    assert min(energies) >= low and max(energies) <= high


def test_the_plans_losses_have_the_published_means() -> None:
    plan = load_campaign(PAPER)
    for name, foot in PAPER.feet.items():
        losses = [setup.c2_ref for setup in plan.setups if setup.foot == name]
        assert sum(losses) / len(losses) == pytest.approx(foot.c2_ref.mean, abs=5e-4)
    everything = [setup.c2_ref for setup in plan.setups]
    assert sum(everything) / 20 == pytest.approx(PAPER.c2_ref_all.mean, abs=5e-4)
    assert (min(everything), max(everything)) == (PAPER.c2_ref_all.low, PAPER.c2_ref_all.high)


def test_a_mechanism_loses_what_it_is_asked_to() -> None:
    mechanisms = Mechanisms(load().rig, 5.0)
    for foot, used_j, wanted in (("0", 15.0, 0.0), ("1", 18.0, 0.164), ("4", 20.0, 0.031)):
        values = mechanisms.values(foot, used_j, wanted)
        model = mechanisms.model(foot)
        found = model.c2_reference(model.compression_m(used_j), values)
        assert found == pytest.approx(wanted, abs=5e-4)
    with pytest.raises(ConfigError, match="beyond what the simulated mechanism can lose"):
        mechanisms.values("1", 18.0, 0.9)


def test_the_analysis_gives_the_published_c1_of_all_feet_with_one_number() -> None:
    plan = load_campaign(PAPER)
    mechanisms = Mechanisms(load().rig, plan.least_damping_n_s_m)
    for setup in plan.setups:
        span = PAPER.feet[setup.foot].c1
        assert span.low is not None and span.high is not None
        compression_m = mechanisms.model(setup.foot).compression_m(setup.reference_energy_j)
        c1 = mechanisms.c1_analysis(setup.foot, compression_m, plan.analysis)
        assert span.low - 1e-3 <= c1 <= span.high + 1e-3, setup.name


def test_draws_repeat_and_fill_their_strata() -> None:
    campaign = configured_campaign()
    first, again, other = (
        drawn_missions(campaign.plan, campaign.soils, campaign.settings, seed) for seed in (4, 4, 5)
    )
    assert first == again and first != other
    lost = [
        [
            value
            for mission in missions
            for hop in mission.hops
            if hop.test and not hop.probe and hop.test.surface == "expanded_clay"
            for name, value in hop.values.items()
            if name.endswith("chi")
        ]
        for missions in (first, other)
    ]
    assert len(lost[0]) == 4 and lost[0] != lost[1]
    assert sum(lost[0]) / 4 == pytest.approx(sum(lost[1]) / 4, abs=0.02)


def test_a_campaign_flies_the_same_on_one_process_and_on_two() -> None:
    campaign = small_campaign("steel-2", "steel-3")
    once, twice = (reproduce_by_flight(campaign, 3, silent, processes) for processes in (1, 2))
    assert content(campaign, once, 3) == content(campaign, twice, 3)
    for run, setup in zip(once.chain.runs, campaign.plan.setups, strict=True):
        assert run.c2_reference is not None
        assert run.c2_reference.value == pytest.approx(setup.c2_ref, abs=0.02)


def test_the_chain_of_a_flown_set_up_is_the_flight_codes_own(sand: tuple[Campaign, list[FlownHop]]) -> None:
    campaign, flown = sand
    chain = through_chain(campaign_runs(flown, campaign.settings)[0], campaign.settings.rig)
    assert [each.hop.probe for each in flown] == [False, True, False]
    assert len(chain.runs) == 2  # the probe is none of the campaign's runs
    test, report, truth = chain.tests[0], flown[-1].report, flown[-1].truth
    assert report.c3 is not None and test.c3_direct is not None and test.run.known_c3 is not None
    assert test.c3_direct.value == pytest.approx(report.c3.value, abs=1e-3)
    assert abs(test.c3_direct.value - truth.c3) < 4.0 * test.c3_direct.sigma
    assert test.run.known_c3 == pytest.approx(truth.c3, abs=0.1)


def test_a_rejected_run_is_left_out_and_named(sand: tuple[Campaign, list[FlownHop]]) -> None:
    """One hop that shows no height: the rest is compared, and the page and the numbers say what is missing."""
    campaign, flown = sand
    lost = replace(flown[-1].report.energies, height_m=None)
    report = replace(flown[-1].report, energies=lost)
    runs, rejected = campaign_runs([*flown[:-1], replace(flown[-1], report=report)], campaign.settings)
    assert [run.reference for run in runs] == [True]
    assert len(rejected) == 1 and rejected[0].startswith(flown[-1].setup.name)
    made = compared(campaign, runs, rejected)
    assert content(campaign, made, 3)["rejected"] == rejected
    assert verdict(made).startswith("1 runs, 1 rejected")
    with pytest.raises(ConfigError, match="no run to compare"):
        compared(campaign, [], rejected)


def test_all_that_is_written_of_a_campaign(tmp_path: Path, sand: tuple[Campaign, list[FlownHop]]) -> None:
    campaign, flown = sand
    made = compared(campaign, *campaign_runs(flown, campaign.settings))
    page = write_results(campaign, made, tmp_path / "out", 3, "how").read_text(encoding="utf-8")
    assert page.count('data-for="figure-') == 5  # no Syar, so no Figure 17
    assert "<script src" not in page and "<link" not in page
    text = (tmp_path / "out/reproduction.json").read_text(encoding="utf-8")
    kept = json.loads(text)
    assert "NaN" not in text and kept["figures"]["c2_ref_foot_1"]["published"] == 0.059
    assert kept["figures"]["c3_direct_quartz_sand_foot_1_0deg"]["runs"] == 1
    table = (tmp_path / "out/runs.csv").read_text(encoding="utf-8")
    assert table.count("\n") == 3


def test_disagreements_are_worked_out_from_the_published_numbers() -> None:
    found = {each.title: each.text for each in disagreements(PAPER, load().rig)}
    assert "6.700 kg, with it to 7.589 kg" in found["Moving mass"]
    assert "1779 mm from the hinge" in found["Radius of the centre of mass"]
    assert "4.3-fold" in found["Compaction of Syar"]
    assert "1.49" in found["Factor of the tilt"] and "1.62" in found["Factor of the tilt"]
    assert "2.1 m at most" in found["Energy of Hopter on the Moon"]
    assert "2.9 to 5.9 m" in found["Energy of Hopter on the Moon"]
    assert moon_height_m(PAPER.moon, 1.0, 3) == 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("name: steel-2", "name: steel-1", r"setups\[1\]\.name = 'steel-1' stands twice"),
        ('name: steel-2, foot: "0"', 'name: steel-2, foot: "9"', r"setups\[1\]\.foot = '9' is unknown"),
        ("surface: syar, energy_j", "surface: mud, energy_j", r"nothing is published for 'mud'"),
        ("c2_ref: 0.013", "c2_ref: 1.3", r"c2_ref = 1.3 is outside its limits"),
    ],
)
def test_a_wrong_plan_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = config_path("paper", "campaign.yaml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "plan.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        load_campaign(PAPER, path)
