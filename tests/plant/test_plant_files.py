"""Plant files: read strictly, written without loss, refused with the place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_helpers import CONFIG, block, plant_of, shipped, use_of

from sim_hal.plant.plantfile import plant_document, read_plant
from sim_hal.plant.simulate import PlantError, compile_plant, load_plant, save_plant

_FRICTION = "friction: {force_balance: {forward: f, backward: f}}"
GOOD = yaml.safe_load(block("push_n - k * q", _FRICTION, "f: {value: 1.0, std: 0, unit: N}"))
CIRCLE = {"a": {"value": "b", "unit": "m"}, "b": {"value": "a", "unit": "m"}}
FORMAT_EXAMPLE = """
format: 1
name: linear_axis
kind: equations
inputs:                      # channels of the recording that drive the simulation
  motor_force_n: N
states:                      # initial: a number, or a channel (its first samples, smoothed), or "fit"
  q: {unit: m, initial: position_m}
  v: {unit: m/s, initial: fit}
parameters:
  mass: {value: 90.0, std: 9.0, unit: kg}
equations:                   # one rate per state; balance: true marks an equation that a missing force may enter
  kinematics:    {state: q, rate: "v"}
  force_balance: {state: v, rate: "motor_force_n / mass", balance: true, per_force: "1 / mass",
                  velocity: v, position: q}
outputs:                     # predicted channels
  position_m: {value: "q"}
effects:
- {physics_id: coulomb_friction, equation: force_balance, parameters: {F_c: {value: 20.4, std: 0.1, unit: N}}}
"""


def test_the_example_of_the_format_is_read() -> None:
    plant = plant_of(FORMAT_EXAMPLE)
    assert plant.name == "linear_axis"
    compiled = compile_plant(plant)
    assert compiled.parameter_names == ("mass", "coulomb_friction.F_c")
    assert compiled.output_units == ("m",)
    assert compiled.fitted_initial_states == ("v",)
    assert compiled.balances["force_balance"].unit == "N"


def round_trip(text: str, folder: Path) -> None:
    plant = plant_of(text)
    save_plant(plant, folder / "plant.yaml")
    again = load_plant(folder / "plant.yaml")
    assert replace(again, source=plant.source) == plant
    assert not list(folder.glob("*.part"))


def test_written_files_read_back_equal(tmp_path: Path) -> None:
    round_trip(FORMAT_EXAMPLE, tmp_path)
    round_trip(yaml.safe_dump(GOOD), tmp_path)
    for path in sorted(CONFIG.glob("*.yaml")):
        round_trip(path.read_text(), tmp_path)


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(0, 1e300))
def test_numbers_survive_to_the_bit(value: float, std: float) -> None:
    plant = plant_of(FORMAT_EXAMPLE).with_values({"mass": value}, {"mass": std})
    again = read_plant(yaml.safe_load(yaml.safe_dump(plant_document(plant))), plant.source)
    assert again == plant


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 2}, r"test\.yaml: format: 2 must be 1"),
        ({"colour": "red"}, r"test\.yaml: colour: unknown key; known here: balances, definitions"),
        ({"kind": 3}, r"kind: 3 must be a name"),
        ({"name": None}, r"name: None must be a name"),
        ({"plant": "another"}, r"name: '\w+' is not what plant says, 'another'"),
        ({"kind": "equation"}, r"kind = 'equation' is not known; known here: equations, axis"),
        ({"parameters": []}, r"parameters: \[\] must be a mapping"),
        ({"parameters.m.value": "heavy"}, r"parameters\.m\.value = 'heavy' must be a number"),
        ({"parameters.m.value": float("nan")}, r"parameters\.m\.value = nan must be finite"),
        ({"parameters.m.std": -1.0}, r"parameters\.m\.std: -1\.0 must not be negative"),
        ({"parameters.m.unit": "stone"}, r"parameters\.m\.unit: 'stone' is not coherent SI|not a unit"),
        ({"parameters.m.unit": "g"}, r"parameters\.m\.unit: 'g' is not coherent SI.*kg"),
        ({"parameters.m.unit": "kg**9**9**9"}, r"'kg\*\*9\*\*9\*\*9' is not a unit: a power is"),
        ({"parameters.m": {"value": 1.0}}, r"key parameters\.m\.std is missing"),
        ({"parameters.lambda": {"value": 1.0, "std": 0, "unit": "1"}}, r"'lambda' is not a name"),
        ({"parameters.sin": {"value": 1.0, "std": 0, "unit": "1"}}, r"'sin' has a meaning of its own"),
        ({"parameters.q": {"value": 1.0, "std": 0, "unit": "1"}}, r"states\.q: the name is taken already"),
        ({"states.q.initial": "nowhere"}, r"states\.q\.initial: 'nowhere' is no start; known: a number, fit, acc"),
        ({"states.q.initial": "m"}, r"states\.q\.initial: `m` has the unit kg, expected m"),
        ({"states.z": {"unit": "m", "initial": 0}}, r"equations: no equation gives the rate of state z"),
        ({"inputs.push_n.interpolation": "sinc"}, r"interpolation: 'sinc' must be hold, linear or cubic"),
        ({"equations.kinematics.rate": "v +"}, r"equations\.kinematics\.rate: not a formula"),
        ({"equations.kinematics.rate": "q"}, r"rate of q: `q` has the unit m, expected m/s"),
        ({"equations.kinematics.rate": "rate(q)"}, r"rate\(…\) may stand in outputs only"),
        ({"equations.kinematics.state": "p"}, r"equations\.kinematics\.state: 'p' is not a state"),
        ({"equations.force_balance.state": "q"}, r"q has a rate already"),
        ({"equations.force_balance.per_force": None}, r"a balance needs per_force"),
        ({"equations.force_balance.per_force": "0"}, r"per_force: is 0 for v: no force would act on it"),
        ({"equations.kinematics.per_force": "1 / m"}, r"kinematics\.per_force: stands there without balance: true"),
        ({"equations.force_balance.velocity": "u"}, r"force_balance\.velocity: 'u' is not known here"),
        ({"equations.force_balance.rate": "os.system"}, r"Attribute is not allowed in a formula\n +os\.system\n"),
        ({"outputs.position_m.value": "v"}, r"outputs\.position_m\.value: `v` has the unit"),
        ({"outputs.height": {"value": "q"}}, r"outputs\.height: channel 'height' does not end in a unit"),
        ({"friction.sideways": {"forward": "f", "backward": "f"}}, r"friction\.sideways: names no balance"),
        ({"friction.force_balance.forward": "m"}, r"friction\.force_balance\.forward: `m` has the unit"),
        ({"definitions": CIRCLE}, r"circle: a → b → a"),
        ({"memories": {"p": {"unit": "m", "lower": "v", "initial": 0}}}, r"memories\.p\.lower: `v` has the unit"),
        ({"flags": {"on": {"when": "q"}}}, r"flags\.on\.when: `q` has the unit m, expected true or false"),
        ({"events": "fire"}, r"events: 'fire' must be a list"),
        ({"sensors": {"position_m": {"range": [1.0, 0.0]}}}, r"position_m\.range: .* must be \[smallest, largest\]"),
        ({"sensors": {"position_m": {"noise_std": -1.0}}}, r"noise_std: -1\.0 must not be negative"),
        ({"sensors": {"positon_m": {}}}, r"sensors\.positon_m: is no channel of the plant; did you mean 'pos"),
        ({"effects": {}}, r"effects: \{\} must be a list"),
        ({"effects": [{"physics_id": "magic", "parameters": {}}]}, r"physics_id 'magic' is not known"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_with_its_place(change: dict[str, object], words: str) -> None:
    data = yaml.safe_load(yaml.safe_dump(GOOD))
    for key, value in change.items():
        place = data
        *path, last = key.split(".")
        for part in path:
            place = place.setdefault(part, {})
        place[last] = value
    with pytest.raises(PlantError, match=words) as caught:
        read_plant(data, "test.yaml")
    assert str(caught.value).startswith("test.yaml: ")


@pytest.mark.parametrize("key", ["format", "kind", "name"])
def test_a_file_that_is_no_plant_says_what_one_has(key: str) -> None:
    with pytest.raises(PlantError, match=rf"^test\.yaml: {key.replace('name', 'plant')}: is missing; "):
        read_plant({name: value for name, value in GOOD.items() if name != key}, "test.yaml")


def test_a_rig_may_have_sensors_of_what_its_plant_does_not_predict() -> None:
    data = {**GOOD, "sensors": {"position_2_m": {"noise_std": 1e-3}, "winding_k": {}}}
    assert set(read_plant(data, "test.yaml").sensors) == {"position_2_m", "winding_k"}


def test_what_is_not_linear_where_it_must_be_is_refused() -> None:
    text = block(
        "push_n",
        "memories: {top: {unit: m, lower: 'q * q / l', initial: 0}}",
        "l: {value: 1.0, std: 0, unit: m}",
    )
    with pytest.raises(PlantError, match="must be linear in the states"):
        compile_plant(plant_of(text))
    moving = block("push_n", "definitions: {d: {value: q, unit: m}}").replace("initial: 0}", "initial: d}", 1)
    with pytest.raises(PlantError, match="may use parameters and known quantities only"):
        compile_plant(plant_of(moving))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "R_em: {value: 8.0",
            "R_xx: {value: 8.0",
            "parameters.R_xx: unknown for kind hop; known: L_CoM, L_em",
        ),
        ("  m_b: {value: 5.393, std: 0.05393, unit: kg}\n", "", "parameters.m_b: is missing"),
        ("m_b: {value: 5.393", "m_b: {value: -5.393", "outside its limits"),
        ("chi: {value: 0.7003", "chi: {value: 1.75", "surfaces.syar.chi.value: 1.75 is outside its limits"),
        (
            "m_b: {value: 5.393, std: 0.05393, unit: kg}",
            "m_b: {value: 5.393, std: 0.05393, unit: m}",
            "'m' must be 'kg'",
        ),
    ],
)
def test_a_wrong_value_of_a_kind_is_refused(old: str, new: str, words: str) -> None:
    text = (CONFIG / "bb0b_hop.yaml").read_text().replace(old, new)
    with pytest.raises(PlantError) as caught:
        plant_of(text)
    assert words in str(caught.value)


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    with pytest.raises(PlantError, match="cannot be read"):
        load_plant(path)
    for content in (b"a: [1", b"\xff\xfe", b"- 1", b"a: 1\na: 2", b""):
        path.write_bytes(content)
        with pytest.raises(PlantError, match=r"plant\.yaml"):
            load_plant(path)


_VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)
_PLACES = [(key,) for key in GOOD] + [
    (key, name) for key, entries in GOOD.items() if isinstance(entries, dict) for name in entries
]


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(_PLACES), _VALUES)
def test_any_damage_to_a_file_is_a_plant_or_a_refusal(place: tuple[str, ...], value: object) -> None:
    data = yaml.safe_load(yaml.safe_dump(GOOD))
    inner = data
    for part in place[:-1]:
        inner = inner[part]
    inner[place[-1]] = value
    try:
        read_plant(data, "test.yaml")
    except PlantError as error:
        assert str(error).startswith("test.yaml")


def test_values_and_effects_by_name() -> None:
    plant = shipped("bb0b_hop")
    changed = plant.with_values({"quartz_sand.k_l": 9e4}, {"k": 300.0})
    assert changed.surfaces["quartz_sand"]["k_l"].value == 9e4
    assert changed.parameters["k"] == replace(plant.parameters["k"], std=300.0)
    with pytest.raises(PlantError, match=r"no parameter 'quartz\.k_l'; known: R_em"):
        plant.with_values({"quartz.k_l": 1.0})
    added = plant.with_effect(use_of(plant, "buoyancy", "ballistic", {"B": 0.1}))
    assert added.without_effects() == plant
