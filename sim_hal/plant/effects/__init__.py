"""One small declaration for each piece of physics that a plant may have, and the catalogue of them all."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points

from sim_hal.plant.effects import (
    electrical,
    flight,
    friction,
    ground,
    mechanism,
    release,
    sensors,
    springs,
    transmission,
)
from sim_hal.plant.effects.base import Effect
from sim_hal.plant.structure import PlantError

GROUP = "hopper.effects"
#: What belongs to one place first: of two that act alike in some place, the first is the better name.
_BUILT_IN = (
    *(electrical.EFFECTS, transmission.EFFECTS, springs.EFFECTS, release.EFFECTS, mechanism.EFFECTS),
    *(ground.EFFECTS, flight.EFFECTS, friction.EFFECTS, sensors.EFFECTS),
)


@lru_cache(maxsize=1)
def catalogue() -> dict[str, Effect]:
    """All effects by physics_id: the built-in ones and those of installed packages.

    A package adds effects by an entry point of group `hopper.effects` that names an `Effect` or a tuple of them.
    Raises `PlantError` when a physics_id stands twice or an entry point names something else.
    """
    found = {effect.physics_id: effect for group in _BUILT_IN for effect in group}
    for point in entry_points(group=GROUP):
        for effect in _loaded(point):
            if effect.physics_id in found:
                raise PlantError(f"entry point {point.name}: effect {effect.physics_id!r} exists already")
            found[effect.physics_id] = effect
    return found


def _loaded(point: EntryPoint) -> tuple[Effect, ...]:
    """The effects that an entry point names; raises `PlantError`."""
    try:
        loaded = point.load()
    except Exception as error:  # the package is somebody else's: anything may go wrong in it
        raise PlantError(f"entry point {point.name} of {GROUP}: {error}") from error
    effects = loaded if isinstance(loaded, (tuple, list)) else (loaded,)
    for effect in effects:
        if not isinstance(effect, Effect):
            raise PlantError(f"entry point {point.name} of {GROUP} names {effect!r}, not an Effect")
    return tuple(effects)
