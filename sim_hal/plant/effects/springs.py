"""What springs and string do beyond a straight line: F against their own compression and extension.

In the drive springs (compression s) and string share the travel x = s + F/k_m, so a change of the springs' law is
solved for s anew; each effect does that for itself, with the others left as they are.
"""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, EffectState, Form

#: Newton's steps from the linear spring's compression; more change nothing where the springs at most treble.
_STEPS = 4


def _solution() -> dict[str, str]:
    """Compression as a multiple u of the linear one, from u + beta u^(n + 1) = 1; u is exactly 1 where beta is 0."""
    found = {
        "linear": "max(0, stiffness * extension) / k",
        "beta": "a * (linear / x_r) ** n * k / (k + k_m)",
        "u_0": "1 - beta / (1 + (n + 1) * beta)",
    }
    for step in range(_STEPS):
        u = f"u_{step}"
        found[f"u_{step + 1}"] = f"{u} - ({u} + beta * {u} ** (n + 1) - 1) / (1 + (n + 1) * beta * {u} ** n)"
    return found | {"stiffer": f"1 + a * (linear * u_{_STEPS} / x_r) ** n"}


_PROGRESSION = (
    EffectParameter("a", "1", "0.005", "0", "0.3", strength=True, least=0.0),
    EffectParameter("n", "1", "2", "2", "2", constant=True, also=("1",), least=1.0, most=4.0),
    EffectParameter("x_r", "m", "0.01", "0.01", "0.01", constant=True, above=0.0),
)

PROGRESSIVE = Effect(
    physics_id="progressive_spring",
    equation="spring_force",
    says="the springs stiffen with compression",
    sentence="The springs stiffen with compression: by {a} at {x_r}, with the power {n} of it.",
    citation="A. M. Wahl, Mechanical Springs, 2nd ed. (1963); G. Duffing (1918) for the power 2",
    forms=(
        Form(
            parameters=_PROGRESSION,
            local=_solution(),
            factors={"string_force": f"u_{_STEPS} * stiffer", "compression": "1 / stiffer"},
            needs=("string_force", "compression", "stiffness", "extension", "k", "k_m"),
        ),
        Form(
            parameters=_PROGRESSION,
            factors={"spring_force": "1 + a * (abs(delta) / x_r) ** n"},
            needs=("spring_force", "delta"),
        ),
        Form(
            parameters=(
                EffectParameter(
                    "k_3",
                    "force/position**3",
                    "0.02 * F / X ** 3",
                    "-100 * F / X ** 3",  # X is the whole travel: half of it to a side, 12 times F at its end
                    "100 * F / X ** 3",
                    strength=True,
                ),
            ),
            force="-k_3 * x ** 3",
            needs=("x",),
            lacks=("opened",),
            sentence="A spring force that grows with the cube of travel is missing, {k_3}.",
        ),
    ),
)

HYSTERESIS = Effect(
    physics_id="spring_hysteresis",
    equation="spring_force",
    balances=("sleeve",),
    mechanical=False,
    says="the springs give back less than they took, whatever the speed",
    sentence="Compressing the springs takes a share {h} more, relaxing gives that share less.",
    citation="P. R. Dahl, AIAA Journal 14 (1976) 1675; T. J. Reid, J. R. Aeronaut. Soc. 60 (1956) 283",
    forms=(
        Form(
            parameters=(
                EffectParameter("h", "1", "0.02", "0", "0.5", strength=True, least=0.0, most=0.99),
                EffectParameter("d_h", "m", "0.0003", "0.00002", "0.01", above=0.0),
            ),
            states={"z": EffectState("1", "r * omega / d_h * (1 - z * sign(omega))")},
            local={"taken": "1 + h * z"},
            factors={
                "string_force": "taken * (k_m + k) / (k_m + k * taken)",
                "compression": "1 / taken",
            },
            needs=("string_force", "compression", "r", "omega", "k", "k_m"),
        ),
        Form(
            parameters=(EffectParameter("h", "1", "0.02", "0", "0.5", strength=True, least=0.0, most=0.99),),
            dry=("h * abs(spring_force)", "h * abs(spring_force)"),
            needs=("opened", "spring_force"),
        ),
    ),
)

STRING_CREEP = Effect(
    physics_id="string_creep",
    equation="spring_force",
    mechanical=False,
    says="the string stretches on under load, viscoelastic",
    sentence="The string creeps by {compliance} with a time constant of {tau}.",
    citation="W. N. Findley, J. S. Lai, K. Onaran, Creep and Relaxation (1976), ch. 5: Kelvin element",
    forms=(
        Form(
            parameters=(
                EffectParameter("compliance", "m/N", "0.1 / k_m", "0", "5 / k_m", strength=True, least=0.0),
                EffectParameter("tau", "s", "3", "0.05", "60", above=0.0),
            ),
            states={"x_c": EffectState("m", "(string_force * compliance - x_c) / tau")},
            terms={"extension": "-x_c"},
            needs=("extension", "string_force"),
        ),
    ),
)

STRING_STIFFENING = Effect(
    physics_id="string_stiffening",
    equation="spring_force",
    mechanical=False,
    says="the string is soft at first and stiffens with load",
    sentence="A share {soft} of the stiffness is missing at first and comes with {x_s} of travel.",
    citation="Y. C. Fung, Biomechanics, 2nd ed. (1993), ch. 7: toe region of what is braided of fibres",
    forms=(
        Form(
            parameters=(
                EffectParameter("soft", "1", "0.1", "0", "1", strength=True, least=0.0, most=1.0),
                EffectParameter("x_s", "m", "0.003", "0.0001", "0.03", above=0.0),
            ),
            terms={"extension": "-soft * x_s * (1 - exp(-max(0, travel) / x_s))"},
            needs=("extension", "travel"),
        ),
    ),
)

STRING_SLACK = Effect(
    physics_id="string_slack",
    equation="spring_force",
    mechanical=False,
    says="the string carries nothing in the first part of travel",
    sentence="The string carries nothing in the first {x_0} of travel.",
    citation="H. M. Irvine, Cable Structures (1981), ch. 1: a slack cable carries no load",
    forms=(
        Form(
            parameters=(EffectParameter("x_0", "m", "0.0005", "0", "0.02", strength=True, least=0.0),),
            terms={"extension": "-x_0"},
            needs=("extension",),
        ),
    ),
)

EFFECTS = (PROGRESSIVE, HYSTERESIS, STRING_CREEP, STRING_STIFFENING, STRING_SLACK)
