"""Effects of release, mechanism and soil in the hop."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, Form

RELEASE_DELAY = Effect(
    physics_id="release_delay",
    equation="latch",
    mechanical=False,
    says="the lock opens later than its trip current",
    sentence="The lock opens {delay} later than its trip current.",
    citation="H. C. Roters, Electromagnetic Devices (1941), ch. 12: travel time of the armature",
    forms=(
        Form(
            parameters=(EffectParameter("delay", "s", "0.001", "0", "0.05", strength=True),),
            terms={"opening_delay": "delay"},
            needs=("opening_delay",),
        ),
    ),
)

LATCH_DRAG = Effect(
    physics_id="latch_drag",
    equation="latch",
    balances=("sleeve",),
    mechanical=False,
    says="the opening lock drags for a while on the string",
    sentence="The opening lock drags on the string with {F_d}, fading over {t_f}.",
    citation="linear fade of a Coulomb drag while the latch clears the string",
    forms=(
        Form(
            parameters=(
                EffectParameter("F_d", "N", "5", "0", "500", strength=True),
                EffectParameter("t_f", "s", "0.01", "0.0005", "0.1"),
            ),
            # v is the compression's rate: the drag acts only while the leg extends.
            force="where(opened and v < 0, F_d * max(0, 1 - since(opened) / t_f), 0)",
            needs=("opened",),
        ),
    ),
)

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
            parameters=(EffectParameter("F_f", "N", "2", "0", "200", strength=True),),
            dry=("F_f", "F_f"),
        ),
    ),
)

SOIL_RATE = Effect(
    physics_id="soil_rate_dependence",
    equation="ground_contact",
    mechanical=False,
    says="the soil resists in proportion to the speed of penetration",
    sentence="The soil resists penetration in proportion to its speed, {c_g}.",
    citation="K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440: damping in contact",
    forms=(
        Form(
            parameters=(EffectParameter("c_g", "N*s/m", "20", "0", "5000", strength=True),),
            terms={"ground_force": "where(contact_force > 0, c_g * max(0, penetration_rate), 0)"},
            needs=("ground_force", "contact_force", "penetration_rate"),
        ),
    ),
)

SOIL_HARDENING = Effect(
    physics_id="soil_hardening",
    equation="ground_contact",
    mechanical=False,
    says="the soil stiffens with depth, a power law",
    sentence="The soil stiffens with depth to the power {n} (reference depth {y_r}).",
    citation="M. G. Bekker, Introduction to Terrain-Vehicle Systems (1969): pressure–sinkage power law",
    forms=(
        Form(
            parameters=(
                EffectParameter("n", "1", "0.1", "-0.5", "2", strength=True),
                EffectParameter("y_r", "m", "0.01", "0.01", "0.01", constant=True),
            ),
            factors={"contact_stiffness": "(max(y_max, 1e-6 * y_r) / y_r) ** n"},
            needs=("contact_stiffness", "y_max"),
        ),
    ),
)

EFFECTS = (RELEASE_DELAY, LATCH_DRAG, SLEEVE_FRICTION, SOIL_RATE, SOIL_HARDENING)
