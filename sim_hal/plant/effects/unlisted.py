"""A force that no name of the catalogue fits: its law is a formula that the plant file itself carries."""

from __future__ import annotations

from collections.abc import Mapping

from sim_hal.plant.effects.base import Effect, EffectParameter, Form

PHYSICS_ID = "unlisted"
REACH = 1e3
"""A coefficient may grow to this many times the value it was found with."""


def unlisted(
    equation: str, law: str, coefficients: Mapping[str, tuple[float, str]], port: str | None
) -> Effect:
    """The effect whose force is `law`, in v, x, load, t and its own coefficients (value and unit by name).

    It is added to the named port where its balance is one, else to the balance's force.
    """
    parameters = tuple(
        EffectParameter(
            name, unit, repr(value), repr(-REACH * abs(value)), repr(REACH * abs(value)), strength=True
        )
        for name, (value, unit) in coefficients.items()
    )
    plain = law.replace("{", "").replace("}", "")
    sizes = ", ".join(f"{name} = {{{name}}}" for name in coefficients)
    form = Form(parameters, force=None if port else law, terms={port: law} if port else {})
    return Effect(
        physics_id=PHYSICS_ID,
        equation=equation,
        forms=(form,),
        says="none of the names fits; a formula is given",
        sentence=f"No known name fits; the force that is missing follows {plain}, with {sizes}.",
        citation="found from recordings by sparse regression",
    )
