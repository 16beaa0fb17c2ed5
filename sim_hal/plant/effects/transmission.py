"""Effects of gearbox and screw of the tensioning drive, and of stops on the way of anything that moves."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectMemory, EffectParameter, Form

BACKLASH = Effect(
    physics_id="backlash",
    equation="transmission",
    mechanical=False,
    says="lost motion at each reversal",
    sentence="{width} of travel is lost at each reversal.",
    citation="M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633",
    forms=(
        Form(
            parameters=(EffectParameter("width", "m", "0.0001", "0", "0.003", strength=True, least=0.0),),
            # The forward flank is engaged at the start; in the gap the nut holds its place.
            memories={"nut": EffectMemory("m", "r * theta", "r * theta + width", "nut_position_m")},
            terms={"travel": "nut - r * theta"},
            needs=("travel", "theta", "r"),
        ),
    ),
)

LEAD_ERROR = Effect(
    physics_id="lead_error",
    equation="transmission",
    mechanical=False,
    says="the screw's travel per turn errs, repeating with each turn",
    sentence="The nut errs once per turn of the screw (sine part {e_sin}, cosine part {e_cos} of travel).",
    citation="ISO 3408-3:2006, Ball screws: travel variation within one turn (2π)",
    forms=(
        Form(
            parameters=(
                EffectParameter("e_sin", "m", "0.005 * p", "-0.15 * p", "0.15 * p", strength=True),
                EffectParameter("e_cos", "m", "0.005 * p", "-0.15 * p", "0.15 * p", strength=True),
            ),
            local={"turn": "theta / N"},
            # The string is just taut where the angle is 0, so the error is counted from there.
            terms={
                "travel": "e_sin * sin(turn) - e_cos * (1 - cos(turn))",
                "reduction": "(e_sin * cos(turn) - e_cos * sin(turn)) / N",
            },
            needs=("travel", "reduction", "theta", "N"),
        ),
    ),
)

END_STOP = Effect(
    physics_id="end_stop",
    equation="transmission",
    balances=("drive_torque",),
    says="a stiff stop near the end of travel",
    sentence="A stop of stiffness {k_e} is met at {x_e}.",
    citation="B. Brogliato, Nonsmooth Mechanics, 3rd ed. (2016), ch. 2: compliant unilateral constraint",
    forms=(
        Form(
            parameters=(
                EffectParameter("k_e", "N/m", "5 * k", "0", "3000 * k", strength=True, least=0.0),
                EffectParameter("x_e", "m", "X_high - 0.05 * X", "X_mid", "X_high"),
            ),
            terms={"stop_force": "k_e * max(0, travel - x_e)"},
            needs=("stop_force", "travel", "k"),
        ),
        Form(
            parameters=(
                EffectParameter(
                    "k_e", "force/position", "5 * F / X", "0", "3000 * F / X", strength=True, least=0.0
                ),
                EffectParameter("x_e", "position", "X_high - 0.05 * X", "X_mid", "X_high"),
            ),
            force="-k_e * max(0, x - x_e)",
            needs=("x",),
            lacks=("opened",),
        ),
    ),
)

EFFECTS = (BACKLASH, LEAD_ERROR, END_STOP)
