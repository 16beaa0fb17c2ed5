"""Effects of the mechanism between body and leg, and of what the two are made of."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, EffectState, Form

SLEEVE_FRICTION = Effect(
    physics_id="sleeve_friction",
    equation="body_momentum",
    balances=("sleeve",),
    mechanical=False,
    says="dry friction in the guide sleeves",
    sentence="Dry friction of {F_f} acts in the guide sleeves.",
    citation="B. Armstrong-Hélouvry et al., Automatica 30 (1994) 1083",
    forms=(
        Form(
            parameters=(EffectParameter("F_f", "N", "2", "0", "200", strength=True, least=0.0),),
            dry=("F_f", "F_f"),
            needs=("opened",),
        ),
    ),
)

LEG_END_STOP = Effect(
    physics_id="leg_end_stop",
    equation="body_momentum",
    balances=("sleeve",),
    mechanical=False,
    says="the leg strikes a stop at the end of its stroke",
    sentence="The leg strikes a stop of stiffness {k_e} and damping {c_e} where the springs are at {delta_e}.",
    citation="W. Goldsmith, Impact (1960), ch. 4: one-sided spring and damper that can only push",
    forms=(
        Form(
            parameters=(
                EffectParameter("k_e", "N/m", "k", "0", "300 * k", strength=True, least=0.0),
                EffectParameter("c_e", "N*s/m", "2 * c", "0", "100 * c", strength=True, least=0.0),
                EffectParameter("delta_e", "m", "-0.002", "-0.04", "0.03"),
            ),
            # Positive forces compress the springs; the stop pushes while they are more relaxed than delta_e.
            local={"pressed": "max(0, delta_e - delta)"},
            force="max(0, k_e * pressed - where(pressed > 0, c_e * v, 0))",
            needs=("opened", "delta"),
        ),
    ),
)

FLEXURE = Effect(
    physics_id="structural_flexure",
    equation="body_momentum",
    balances=("body_momentum",),
    mechanical=False,
    says="a structural mode of the arm or leg rings",
    sentence="A share {mu} of the body's mass rings on the rest at {f} Hz with damping {zeta}.",
    citation="D. J. Inman, Engineering Vibration, 4th ed. (2014), ch. 4: one mode and its effective mass",
    forms=(
        Form(
            parameters=(
                EffectParameter("mu", "1", "0.05", "0", "0.9", strength=True, least=0.0, most=0.95),
                EffectParameter("f", "1/s", "60", "5", "600", above=0.0),
                EffectParameter("zeta", "1", "0.02", "0.001", "0.5", least=0.0),
            ),
            local={
                "omega_f": "2 * pi * f",
                "pull": "omega_f ** 2 * q_f + 2 * zeta * omega_f * (v_f - v)",
            },
            # q_f: deflection of the mode, which starts bent under its weight; v_f: speed of its mass.
            states={
                "q_f": EffectState("m", "where(opened, v_f - v, 0)", "-g / (2 * pi * f) ** 2"),
                "v_f": EffectState("m/s", "where(opened, -body_gravity - pull, 0)"),
            },
            force="mu * body_mass * (body_gravity + pull)",
            inertia="-mu * body_mass",
            needs=("opened", "body_mass", "body_gravity"),
        ),
    ),
)

MASS_DISTRIBUTION = Effect(
    physics_id="mass_distribution",
    equation="body_momentum",
    mechanical=False,
    says="the mass is divided between body and leg otherwise than modelled",
    sentence="{m_s} of the body's mass moves with the leg.",
    citation="Wiśniewski et al., Energies 14 (2021) 4282, Eq. (1): half of the springs' mass on each side",
    forms=(
        Form(
            parameters=(
                EffectParameter("m_s", "kg", "0.05 * m_l", "-0.5 * m_l", "0.5 * m_b", strength=True),
            ),
            terms={"body_mass": "-m_s", "leg_mass": "m_s"},
            needs=("body_mass", "leg_mass"),
        ),
    ),
)

EFFECTS = (SLEEVE_FRICTION, LEG_END_STOP, FLEXURE, MASS_DISTRIBUTION)
