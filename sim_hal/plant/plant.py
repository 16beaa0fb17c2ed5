"""A plant: a structure, the values of its parameters, its sensors and the effects added to it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from sim_hal.plant.effects import catalogue
from sim_hal.plant.effects.base import Effect, Form
from sim_hal.plant.effects.unlisted import PHYSICS_ID, unlisted
from sim_hal.plant.structure import Balance, PlantError, Structure
from sim_hal.plant.units import channel_unit, dimension


@dataclass(frozen=True)
class Parameter:
    """A value with its standard uncertainty (0: exact) and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Sensor:
    """What is known of a channel: white noise (1σ), step, smallest and largest reading, all in its unit."""

    noise_std: float = 0.0
    resolution: float | None = None
    range: tuple[float, float] | None = None


@dataclass(frozen=True)
class EffectUse:
    """An effect at its place: the equation it enters, or the channel of a sensor fault, with parameter values.

    `law` is the force of an effect that no catalogue lists, a formula of v, x, load, t and the parameters.
    """

    physics_id: str
    equation: str
    channel: str | None
    parameters: Mapping[str, Parameter]
    law: str | None = None


@dataclass(frozen=True)
class Plant:
    """Everything that a simulation needs to know of a rig."""

    name: str
    kind: str
    structure: Structure
    parameters: Mapping[str, Parameter]
    surfaces: Mapping[str, Mapping[str, Parameter]] = field(default_factory=dict)
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    effects: tuple[EffectUse, ...] = ()
    geometry: str = "vertical"
    source: str = "plant"
    #: What the file says of the structure (`kind: equations`), kept for writing it again.
    document: Mapping[str, object] = field(default_factory=dict)

    def flat(self) -> dict[str, Parameter]:
        """All parameters by flat name: own ones, `SURFACE.NAME`, `[EQUATION.]EFFECT.NAME`."""
        found = dict(self.parameters)
        for surface, values in self.surfaces.items():
            found |= {f"{surface}.{name}": value for name, value in values.items()}
        for use in self.effects:
            prefix = self.prefix(use)
            found |= {f"{prefix}.{name}": value for name, value in use.parameters.items()}
        return found

    def prefix(self, use: EffectUse) -> str:
        """What stands before an effect's own names in flat names."""
        if use.channel is not None:
            return f"{use.channel}.{use.physics_id}"
        return use.physics_id if len(self.structure.balances) < 2 else f"{use.equation}.{use.physics_id}"

    def with_values(self, values: Mapping[str, float], stds: Mapping[str, float] | None = None) -> Plant:
        """The plant with other values (and uncertainties) of parameters, by flat name; raises `PlantError`."""
        known = self.flat()
        for name in (*values, *(stds or {})):
            if name not in known:
                raise PlantError(f"{self.source}: no parameter {name!r}; known: {', '.join(known)}")

        def new(name: str, old: Parameter) -> Parameter:
            return replace(old, value=values.get(name, old.value), std=(stds or {}).get(name, old.std))

        return replace(
            self,
            parameters={name: new(name, old) for name, old in self.parameters.items()},
            surfaces={
                surface: {name: new(f"{surface}.{name}", old) for name, old in items.items()}
                for surface, items in self.surfaces.items()
            },
            effects=tuple(
                replace(
                    use,
                    parameters={
                        name: new(f"{self.prefix(use)}.{name}", old) for name, old in use.parameters.items()
                    },
                )
                for use in self.effects
            ),
        )

    def with_effect(self, use: EffectUse) -> Plant:
        """The plant with one more effect; raises `PlantError` where it cannot act."""
        if any(self.prefix(use) == self.prefix(other) for other in self.effects):
            raise PlantError(f"{self.source}: effects: {self.prefix(use)} stands there twice")
        check_values(self, use, check_use(self, use))
        return replace(self, effects=(*self.effects, use))

    def with_interpolation(self, interpolation: str) -> Plant:
        """The plant with all its inputs running otherwise between samples, one of `INTERPOLATIONS`."""
        inputs = {
            name: replace(spec, interpolation=interpolation) for name, spec in self.structure.inputs.items()
        }
        document = dict(self.document)
        if "inputs" in document:
            document["inputs"] = {name: dict(vars(spec)) for name, spec in inputs.items()}
        return replace(self, structure=replace(self.structure, inputs=inputs), document=document)

    def without_effects(self) -> Plant:
        """The plant as it was before any effect was added."""
        return replace(self, effects=())

    def balance(self, effect: Effect, equation: str) -> Balance | None:
        """The balance that an effect entering `equation` acts on."""
        balances = self.structure.balances
        if effect.balances and equation == effect.equation:
            return next((balances[name] for name in effect.balances if name in balances), None)
        return balances.get(equation)

    def form(self, effect: Effect, balance: Balance | None, channel: str | None = None) -> Form | None:
        """The form in which an effect acts here, or None."""
        quantities = self.structure.parameters
        absent = {name for name, item in quantities.items() if item.optional} - self.parameters.keys()
        symbols = self.structure.units().keys() - absent
        symbols |= {"load"} if balance is not None and load_of(self.structure, balance) else set()
        symbols |= {"x"} if balance is not None and balance.position is not None else set()
        return effect.form(frozenset(symbols), None if channel is None else channel_unit(channel))

    def places(self, effect: Effect) -> tuple[tuple[str, str | None], ...]:
        """Where an effect may enter this plant: pairs of equation and channel (None but for sensor faults).

        Forces of the air act where something moves along a line, dry friction and the like where anything moves.
        """
        if effect.kind == "sensor":
            channels = self.structure.outputs
            return tuple((effect.equation, name) for name in channels if self.form(effect, None, name))
        home = self.balance(effect, effect.equation)
        free = (
            self.kind == "equations" and effect.mechanical
        )  # equations of other rigs have names of their own
        if (home is not None or not effect.mechanical) and not free:
            form = self.form(effect, home)
            if form is None or (needs_balance(form) and not enters(home)):
                return ()
            # Plants of other rigs have equations of their own names.
            named = home is not None and self.kind == "equations"
            return ((home.name if home is not None and named else effect.equation, None),)
        return tuple(
            (name, None) for name, balance in self.structure.balances.items() if self._moves(effect, balance)
        )

    def _moves(self, effect: Effect, balance: Balance) -> bool:
        """Whether a mechanical effect can act in this balance; another rig's position may well be a voltage."""
        turns_or_shifts = balance.unit in ("N", "N*m") or self.kind == "equations"
        right = dimension(balance.unit) == dimension("N") if effect.along_line else turns_or_shifts
        moves = right and balance.port is None and balance.velocity is not None
        return moves and self.form(effect, balance) is not None


def needs_balance(form: Form) -> bool:
    """Whether a form adds a force, dry friction or inertia, and so needs a balance to add it to."""
    return bool(form.force or form.dry or form.inertia)


def enters(balance: Balance | None) -> bool:
    """Whether a force may enter here: a balance that is no port of a definition."""
    return balance is not None and balance.port is None


def load_of(structure: Structure, balance: Balance) -> bool:
    """Whether a balance has a load: its own, or else the force of its only equation."""
    return balance.load is not None or (balance.port is None and len(balance.per_force) == 1)


def find_effect(physics_id: str, source: str) -> Effect:
    """The effect of the catalogue; raises `PlantError` with the known ones."""
    effects = catalogue()
    if physics_id not in effects:
        raise PlantError(
            f"{source}: physics_id {physics_id!r} is not known; known: {', '.join(sorted(effects))}"
        )
    return effects[physics_id]


def effect_of(plant: Plant, use: EffectUse) -> Effect:
    """The effect in use: of the catalogue, or with the law that the plant file gives; raises `PlantError`."""
    if use.law is None:
        return find_effect(use.physics_id, plant.source)
    if use.physics_id != PHYSICS_ID:
        raise PlantError(
            f"{plant.source}: effects: {use.physics_id}: only {PHYSICS_ID!r} may give a law of its own"
        )
    balance = plant.structure.balances.get(use.equation)
    coefficients = {name: (parameter.value, parameter.unit) for name, parameter in use.parameters.items()}
    return unlisted(use.equation, use.law, coefficients, balance.port if balance else None)


def check_use(plant: Plant, use: EffectUse) -> Form:
    """The form in which the effect acts on the plant; raises `PlantError` saying why it cannot."""
    effect = effect_of(plant, use)
    where = f"{plant.source}: effects: {use.physics_id}"
    if effect.kind == "sensor":
        if use.channel not in plant.structure.outputs:
            known = ", ".join(plant.structure.outputs)
            raise PlantError(f"{where}: channel = {use.channel!r} is no output of the plant; known: {known}")
        form = plant.form(effect, None, use.channel)
    else:
        balance = plant.balance(effect, use.equation)
        form = plant.form(effect, balance)
        if form is not None and needs_balance(form) and not enters(balance):
            known = ", ".join(plant.structure.balances)
            raise PlantError(
                f"{where}: equation = {use.equation!r} is no balance it can enter; known: {known}"
            )
    if form is None:
        place = repr(use.channel or use.equation)
        raise PlantError(f"{where}: cannot act on a plant of kind {plant.kind} at {place}")
    names = {parameter.name for parameter in form.parameters}
    if names != set(use.parameters):
        wrong = sorted(names ^ set(use.parameters))
        raise PlantError(
            f"{where}: parameters must be {', '.join(sorted(names))}; look at {', '.join(wrong)}"
        )
    return form


def check_values(plant: Plant, use: EffectUse, form: Form) -> None:
    """Raise `PlantError` for a parameter outside what is physical."""
    for parameter in form.parameters:
        fault = parameter.fault(use.parameters[parameter.name].value)
        if fault is not None:
            raise PlantError(f"{plant.source}: effects: {use.physics_id}.{parameter.name}: {fault}")


def duplicates(plant: Plant) -> Iterable[str]:
    """Prefixes of effects that stand more than once."""
    prefixes = [plant.prefix(use) for use in plant.effects]
    return sorted({prefix for prefix in prefixes if prefixes.count(prefix) > 1})
