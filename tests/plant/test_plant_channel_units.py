"""Units at the end of channel names: compound ones are read whole, and none that is in use changes its meaning."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim_hal.plant.simulate import load_plant
from sim_hal.plant.units import CHANNEL_UNITS, UnitError, channel_unit, dimension

PLANTS = sorted((Path(__file__).resolve().parents[2] / "config" / "plant").glob("*.yaml"))
ADDED = {
    "inflow_m3_s": "m^3/s",
    "feed_kg_s": "kg/s",
    "heating_k_s": "K/s",
    "flux_w_m2": "W/m^2",
    "tank_m3": "m^3",
}


@pytest.mark.parametrize(("channel", "unit"), ADDED.items())
def test_a_compound_unit_is_read_whole(channel: str, unit: str) -> None:
    assert channel_unit(channel) == unit


def test_every_unit_of_a_name_is_coherent_si_and_a_bare_or_unknown_one_is_none() -> None:
    assert all(dimension(unit) is not None for unit in CHANNEL_UNITS.values())
    for wrong in ("k_furlong", "m3", "flow_l_min"):
        with pytest.raises(UnitError):
            channel_unit(wrong)


@pytest.mark.parametrize("path", PLANTS, ids=lambda path: path.stem)
def test_channels_of_the_shipped_plants_have_the_units_that_their_formulas_have(path: Path) -> None:
    """Loading checks each formula's unit against that of its channel's name; none ends in a unit added later."""
    structure = load_plant(path).structure
    for channel in (*structure.outputs, *structure.inputs):
        assert channel_unit(channel) not in ADDED.values()
