"""Friction and other forces that may act in any mechanical balance of any plant."""

from __future__ import annotations

from sim_hal.plant.effects.base import WHOLE, Effect, EffectParameter, EffectState, Form


def _level(name: str) -> EffectParameter:
    """A level of dry friction."""
    return EffectParameter(name, "force", "0.02 * F", "0", "F", strength=True, least=0.0)


COULOMB = Effect(
    physics_id="coulomb_friction",
    equation="drive_torque",
    says="dry friction, constant, against the motion",
    sentence="Dry friction of {F_c} against the motion is missing.",
    citation="B. Armstrong-Hélouvry et al., Automatica 30 (1994) 1083",
    forms=(
        Form(
            parameters=(_level("F_c"),),
            dry=("F_c", "F_c"),
        ),
    ),
)

VISCOUS = Effect(
    physics_id="viscous_friction",
    equation="drive_torque",
    says="friction proportional to speed",
    sentence="Friction proportional to speed, {F_v}, is missing.",
    citation="B. Armstrong-Hélouvry et al., Automatica 30 (1994) 1083",
    forms=(
        Form(
            parameters=(
                EffectParameter(
                    "F_v", "force/velocity", "0.02 * F / V", "0", "5 * F / V", strength=True, least=0.0
                ),
            ),
            force="-F_v * v",
        ),
    ),
)

STRIBECK = Effect(
    physics_id="stribeck_friction",
    equation="drive_torque",
    says="friction falls from a higher value as speed rises from rest",
    sentence="Friction is {F_s} higher at rest and falls off within {v_s} of speed.",
    citation="B. Armstrong-Hélouvry et al., Automatica 30 (1994) 1083",
    forms=(
        Form(
            parameters=(
                _level("F_s"),
                EffectParameter("v_s", "velocity", "0.05 * V", "0.001 * V", "0.5 * V", above=0.0),
            ),
            dry=("F_s * exp(-(v / v_s) ** 2)", "F_s * exp(-(v / v_s) ** 2)"),
        ),
    ),
)

ASYMMETRIC = Effect(
    physics_id="asymmetric_friction",
    equation="drive_torque",
    says="friction differs with the direction of motion, or a constant offset force acts",
    sentence="Friction differs with direction: a constant force of {F_o} acts against forward motion.",
    citation="A. Janot, M. Gautier, M. Brunot, Workshop on Nonlinear System Identification Benchmarks (2019)",
    forms=(
        Form(
            parameters=(EffectParameter("F_o", "force", "0.02 * F", "-F", "F", strength=True),),
            force="-F_o",
        ),
    ),
)

QUADRATIC = Effect(
    physics_id="quadratic_friction",
    equation="drive_torque",
    says="friction grows with the square of speed",
    sentence="Friction that grows with the square of speed, {F_q}, is missing.",
    citation="B. Armstrong-Hélouvry et al., Automatica 30 (1994) 1083",
    forms=(
        Form(
            parameters=(
                EffectParameter(
                    "F_q",
                    "force/velocity**2",
                    "0.02 * F / V ** 2",
                    "0",
                    "5 * F / V ** 2",
                    strength=True,
                    least=0.0,
                ),
            ),
            force="-F_q * v * abs(v)",
        ),
    ),
)

POSITION_DEPENDENT = Effect(
    physics_id="position_dependent_friction",
    equation="drive_torque",
    says="friction changes along the travel",
    sentence="Friction is {F_p} higher around position {x_p}, over a width of {w_p}.",
    citation="B. Armstrong-Hélouvry et al., Automatica 30 (1994) 1083",
    forms=(
        Form(
            parameters=(
                EffectParameter("F_p", "force", "0.02 * F", "-F", "F", strength=True),
                EffectParameter("x_p", "position", "X_mid", "X_low", "X_high"),
                EffectParameter("w_p", "position", "0.1 * X", "0.01 * X", "X", above=0.0),
            ),
            dry=("F_p * exp(-((x - x_p) / w_p) ** 2)", "F_p * exp(-((x - x_p) / w_p) ** 2)"),
            needs=("x",),
        ),
    ),
)

LOAD_DEPENDENT = Effect(
    physics_id="load_dependent_friction",
    equation="transmission",
    balances=("drive_torque",),
    says="friction grows with the force carried",
    sentence="Friction grows with the force carried: {mu} of it is lost.",
    citation="M. Linderoth, A. Stolt, A. Robertsson, R. Johansson, IROS (2013) 3296",
    forms=(
        Form(
            parameters=(EffectParameter("mu", "1", "0.02", "0", "1", strength=True, least=0.0),),
            dry=("mu * abs(load)", "mu * abs(load)"),
            needs=("load",),
        ),
    ),
)

ADDED_INERTIA = Effect(
    physics_id="added_inertia",
    equation="drive_torque",
    says="more moving inertia than modelled",
    sentence="{m_a} more inertia moves than modelled.",
    citation="Newton's second law",
    forms=(
        Form(
            parameters=(
                EffectParameter("m_a", "force*s/velocity", "0.02 * M", "-0.5 * M", "2 * M", strength=True),
            ),
            inertia="m_a",
        ),
    ),
)

_RIPPLE = (
    EffectParameter("F_sin", "force", "A_sin", "-F", "F", strength=True),
    EffectParameter("F_cos", "force", "A_cos", "-F", "F", strength=True),
)

TORQUE_RIPPLE = Effect(
    physics_id="torque_ripple",
    equation="drive_torque",
    says="a torque that repeats with each turn",
    sentence="A force repeats with each turn (sine part {F_sin}, cosine part {F_cos}).",
    citation="J. Holtz, L. Springob, IEEE Trans. Ind. Electron. 43 (1996) 247",
    forms=(
        # Of the motor, or (order 1/N) of what the gearbox drives.
        Form(
            parameters=(
                *_RIPPLE,
                EffectParameter("order", "1", "1", "1", "1", constant=True, also=("1 / N",), above=0.0),
            ),
            force="F_sin * sin(order * theta) + F_cos * cos(order * theta)",
            needs=("theta", "N", "dry_torque"),
        ),
        Form(
            parameters=(
                *_RIPPLE,
                EffectParameter("period", "position", "P", "0.0001 * X", "0.5 * X", above=0.0),
            ),
            force="F_sin * sin(2 * pi * x / period) + F_cos * cos(2 * pi * x / period)",
            needs=("x",),
            lacks=("opened",),
        ),
    ),
)

PRESLIDING = Effect(
    physics_id="presliding_hysteresis",
    equation="drive_torque",
    says="friction acts as a stiff hysteretic spring before sliding",
    sentence="Before sliding, friction acts like a spring; it takes {s_p} of travel to build up.",
    citation="P. R. Dahl, AIAA Journal 14 (1976) 1675",
    forms=(
        # Where the plant has dry friction of its own, that friction builds up over a distance.
        Form(
            parameters=(
                EffectParameter("s_p", "velocity*s", "0.5", "0.01", "50", above=0.0),
                WHOLE,
            ),
            states={"z": EffectState("1", "v / s_p * (1 - z * sign(v))")},
            force="-share * tau_c * z",
            factors={"dry_torque": "1 - share"},
            needs=("dry_torque", "tau_c"),
        ),
        Form(
            parameters=(
                _level("F_d"),
                EffectParameter("s_p", "velocity*s", "0.01 * X", "1e-5 * X", "X", above=0.0),
            ),
            states={"z": EffectState("1", "v / s_p * (1 - z * sign(v))")},
            force="-F_d * z",
        ),
    ),
)

WARM_UP = Effect(
    physics_id="warm_up_friction",
    equation="drive_torque",
    says="friction falls as the lubricant warms with work done",
    sentence="Friction starts {F_w} higher and falls off as it does {W_0} of work.",
    citation="A. Carvalho Bittencourt, S. Gunnarsson, J. Dyn. Syst. Meas. Control 134 (2012) 051013",
    forms=(
        Form(
            parameters=(
                _level("F_w"),
                EffectParameter("W_0", "J", "5", "0.1", "100", above=0.0),
            ),
            states={"W": EffectState("J", "(dry_torque + F_w * exp(-W / W_0)) * abs(v)")},
            dry=("F_w * exp(-W / W_0)", "F_w * exp(-W / W_0)"),
            needs=("dry_torque",),
        ),
        Form(
            parameters=(
                _level("F_w"),
                EffectParameter("W_0", "J", "0.2 * F * X", "0.001 * F * X", "10 * F * X", above=0.0),
            ),
            states={"W": EffectState("J", "F_w * exp(-W / W_0) * abs(v)")},
            dry=("F_w * exp(-W / W_0)", "F_w * exp(-W / W_0)"),
        ),
    ),
)

EFFECTS = (
    COULOMB,
    VISCOUS,
    STRIBECK,
    ASYMMETRIC,
    QUADRATIC,
    POSITION_DEPENDENT,
    LOAD_DEPENDENT,
    ADDED_INERTIA,
    TORQUE_RIPPLE,
    PRESLIDING,
    WARM_UP,
)
