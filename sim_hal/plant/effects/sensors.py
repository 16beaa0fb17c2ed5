"""Faults of sensors: the plant is right, a channel reads something else. They act in the order of their rank."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, Form

_CITATION = "J. Fraden, Handbook of Modern Sensors, 5th ed. (2016), ch. 3"

SCALE = Effect(
    physics_id="sensor_scale",
    equation="sensor",
    kind="sensor",
    rank=2,
    says="a channel reads in wrong proportion",
    sentence="The channel reads in wrong proportion, by a factor of 1 + {scale}.",
    citation=_CITATION,
    forms=(
        Form(
            parameters=(EffectParameter("scale", "1", "0.02", "-0.5", "0.5", strength=True),),
            sensor="y + scale * y",
        ),
    ),
)

BIAS = Effect(
    physics_id="sensor_bias",
    equation="sensor",
    kind="sensor",
    rank=4,
    says="a channel reads off by a constant",
    sentence="The channel reads {bias} too much.",
    citation=_CITATION,
    forms=(
        Form(
            parameters=(EffectParameter("bias", "channel", "0.01 * Y", "-Y", "Y", strength=True),),
            sensor="y + bias",
        ),
    ),
)

DRIFT = Effect(
    physics_id="sensor_drift",
    equation="sensor",
    kind="sensor",
    rank=3,
    says="a channel's zero moves with time",
    sentence="The channel's zero drifts at {drift}.",
    citation=_CITATION,
    forms=(
        Form(
            parameters=(
                EffectParameter("drift", "channel/s", "0.01 * Y / T", "-Y / T", "Y / T", strength=True),
            ),
            sensor="y + drift * elapsed",
        ),
    ),
)

DELAY = Effect(
    physics_id="sensor_delay",
    equation="sensor",
    kind="sensor",
    rank=0,
    says="a channel is late",
    sentence="The channel is {delay} late.",
    citation=_CITATION,
    forms=(
        Form(
            parameters=(EffectParameter("delay", "s", "0.001 * T", "0", "0.1 * T", strength=True),),
            delay="delay",
        ),
    ),
)

EFFECTS = (DELAY, SCALE, DRIFT, BIAS)
