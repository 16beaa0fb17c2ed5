"""One small declaration for each piece of physics that a plant may have, and the catalogue of them all."""

from __future__ import annotations

from functools import lru_cache
from importlib.metadata import entry_points

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
    Raises `ValueError` when a physics_id stands twice or an entry point names something else.
    """
    found = {effect.physics_id: effect for group in _BUILT_IN for effect in group}
    for point in entry_points(group=GROUP):
        loaded = point.load()
        for effect in (loaded,) if isinstance(loaded, Effect) else tuple(loaded):
            if not isinstance(effect, Effect):
                raise ValueError(f"entry point {point.name} of {GROUP} names {effect!r}, not an Effect")
            if effect.physics_id in found:
                raise ValueError(f"entry point {point.name}: effect {effect.physics_id!r} exists already")
            found[effect.physics_id] = effect
    return found
