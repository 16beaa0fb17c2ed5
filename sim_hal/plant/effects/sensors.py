"""Faults of sensors: the plant is right, a channel reads something else. They act in the order of their rank."""

from __future__ import annotations

from sim_hal.plant.effects.base import WHOLE, Effect, EffectParameter, Form

_CITATION = "J. Fraden, Handbook of Modern Sensors, 5th ed. (2016), ch. 3"
# Usual sizes are those of a cheap sensor: NXP MPX5010, accuracy 5 % of the span, offset stability 0.5 %.
LAG = "2 * S"
"""How late or slow a sensor usually is at most: it is sampled about as fast as it can follow."""

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
            parameters=(EffectParameter("scale", "1", "0.02", "-0.5", "0.5", strength=True, usual="0.05"),),
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
            parameters=(
                EffectParameter("bias", "channel", "0.01 * Y", "-Y", "Y", strength=True, usual="0.05 * Y"),
            ),
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
                EffectParameter(
                    *("drift", "channel/s", "0.01 * Y / T", "-Y / T", "Y / T"),
                    strength=True,
                    usual="0.01 * Y / D",
                ),
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
            parameters=(
                EffectParameter(
                    "delay", "s", "0.001 * T", "0", "0.1 * T", strength=True, least=0.0, usual=LAG
                ),
            ),
            delay="delay",
        ),
    ),
)

BANDWIDTH = Effect(
    physics_id="sensor_bandwidth",
    equation="sensor",
    kind="sensor",
    rank=1,
    says="a channel is low-pass filtered",
    sentence="The channel is low-pass filtered, first order with a time constant of {tau}.",
    citation=_CITATION,
    forms=(
        Form(
            parameters=(
                EffectParameter(
                    *("tau", "s", LAG, "0.1 * S", "0.2 * T"),
                    above=0.0,
                    usual=LAG,
                    also=("8 * S", "0.003 * T"),
                ),
                WHOLE,
            ),
            low_pass="tau",
            sensor="y + share * (filtered - y)",
        ),
    ),
)

SATURATION = Effect(
    physics_id="sensor_saturation",
    equation="sensor",
    kind="sensor",
    rank=5,
    says="a channel is clipped",
    sentence="The channel is clipped at ±{limit}.",
    citation=_CITATION,
    forms=(
        Form(
            parameters=(
                EffectParameter("limit", "channel", "0.98 * Y_max", "0.2 * Y_max", "1.5 * Y_max", above=0.0),
                WHOLE,
            ),
            sensor="y + share * (max(-limit, min(limit, y)) - y)",
        ),
    ),
)

_TILT = EffectParameter("beta", "rad", "0.03", "-0.7", "0.7", strength=True, least=-1.57, most=1.57)

MISALIGNMENT = Effect(
    physics_id="sensor_misalignment",
    equation="sensor",
    kind="sensor",
    rank=0,
    says="the sensing axis is tilted, or reads part of another axis",
    sentence="The sensing axis is tilted by {beta}.",
    citation="D. H. Titterton, J. L. Weston, Strapdown Inertial Navigation, 2nd ed. (2004), ch. 8",
    forms=(
        # The body turns about a hinge: tilted outwards, the axis reads a part of the centripetal acceleration.
        Form(
            parameters=(_TILT,),
            sensor="y * cos(beta) + v_b ** 2 / L_CoM * sin(beta)",
            needs=("v_b", "L_CoM"),
            unit="m/s^2",
        ),
        Form(parameters=(_TILT,), sensor="y * cos(beta)", unit="m/s^2"),
    ),
)

CLOCK_SKEW = Effect(
    physics_id="clock_skew",
    equation="sensor",
    kind="sensor",
    rank=0,
    says="a channel's clock runs fast or slow",
    sentence="The channel's clock runs slow by a share {skew}: it reads what is to come.",
    citation="D. L. Mills, Computer Network Time Synchronization, 2nd ed. (2010), ch. 1: frequency error",
    forms=(
        Form(
            parameters=(
                EffectParameter("skew", "1", "0.002", "-0.1", "0.1", strength=True, least=-0.5, most=0.5),
            ),
            skew="-skew",
        ),
    ),
)

EFFECTS = (DELAY, MISALIGNMENT, BANDWIDTH, CLOCK_SKEW, SCALE, DRIFT, BIAS, SATURATION)
