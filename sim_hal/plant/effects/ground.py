"""What soil does beyond an elastic line with losses."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, Form

SOIL_RATE = Effect(
    physics_id="soil_rate_dependence",
    equation="ground_contact",
    mechanical=False,
    says="the soil resists in proportion to the speed of penetration",
    sentence="The soil resists penetration in proportion to its speed, {c_g}.",
    citation="K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440: damping in contact",
    forms=(
        Form(
            parameters=(EffectParameter("c_g", "N*s/m", "20", "0", "5000", strength=True, least=0.0),),
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
                EffectParameter("n", "1", "0.1", "-0.5", "2", strength=True, above=-1.0),
                EffectParameter("y_r", "m", "0.01", "0.01", "0.01", constant=True, above=0.0),
            ),
            factors={
                "contact_stiffness": "(max(y_max, 1e-6 * y_r) / y_r) ** n",
                # The share 1 - chi of the work of loading comes back, which is less than the line's own triangle.
                "unloading_share": "min(2 / (2 + n), 1 / (1 - chi))",
                "rest_sinkage": "((m_b + m_l) * g / (k_l * y_r)) ** (-n / (1 + n))",
            },
            needs=("contact_stiffness", "unloading_share", "y_max", "rest_sinkage"),
        ),
    ),
)

ADDED_MASS = Effect(
    physics_id="soil_added_mass",
    equation="ground_contact",
    balances=("leg_momentum",),
    mechanical=False,
    says="soil under the foot moves with it",
    sentence="Soil of {m_a} moves with the foot, picked up within the first {y_p} of sinkage.",
    citation="J. Aguilar, D. I. Goldman, Nature Physics 12 (2016) 278: added mass in jumping on grains",
    forms=(
        Form(
            parameters=(
                EffectParameter("m_a", "kg", "0.05 * m_l", "0", "5 * m_l", strength=True, least=0.0),
                EffectParameter("y_p", "m", "0.0005", "0.0005", "0.0005", constant=True, above=0.0),
            ),
            # Soil at rest has to be brought to the foot's speed: d(m v)/dt, not m dv/dt, while it is picked up.
            force="where(contact_force > 0 and penetration < y_p, m_a / y_p * max(0, penetration_rate) ** 2, 0)",
            inertia="where(contact_force > 0, m_a * min(1, penetration / y_p), 0)",
            needs=("contact_force", "penetration", "penetration_rate"),
        ),
    ),
)

ADHESION = Effect(
    physics_id="soil_adhesion",
    equation="ground_contact",
    mechanical=False,
    says="the soil pulls on the foot as it lifts",
    sentence="The soil pulls on the lifting foot with up to {F_a}, {d_a} off the ground.",
    citation="X.-P. Xu, A. Needleman, Model. Simul. Mater. Sci. Eng. 1 (1993) 111: traction over separation",
    forms=(
        Form(
            parameters=(
                EffectParameter("F_a", "N", "5", "0", "1000", strength=True, least=0.0),
                EffectParameter("d_a", "m", "0.001", "0.0001", "0.03", above=0.0),
            ),
            local={
                "gap": "max(0, y_max * (1 - unloading_share) - penetration)",
                "slow": "0.01 * sqrt(g * d_a)",  # a foot that neither lifts nor sinks is held by a part of the pull
            },
            terms={
                "ground_force": "-F_a * (gap / d_a) * exp(1 - gap / d_a) * min(1, max(0, -penetration_rate / slow))",
            },
            needs=("ground_force", "penetration", "penetration_rate", "unloading_share", "y_max", "g"),
        ),
    ),
)

COMPACTION = Effect(
    physics_id="soil_compaction",
    equation="ground_contact",
    mechanical=False,
    says="the soil stiffens and loses less from hop to hop in one place",
    sentence="Hops in one place compact the soil over {n_c} hops: {a} stiffer, {b} of its loss gone.",
    citation="M. G. Bekker, Theory of Land Locomotion (1956), ch. 5: repeated loading of one soil",
    forms=(
        Form(
            parameters=(
                EffectParameter("a", "1", "0.5", "0", "20", strength=True, least=0.0),
                EffectParameter("b", "1", "0.2", "0", "1", strength=True, least=0.0, most=1.0),
                EffectParameter("n_c", "1", "2", "0.3", "20", above=0.0),
            ),
            local={"done": "1 - exp(-hop_index / n_c)"},
            factors={
                "contact_stiffness": "1 + a * done",
                "unloading_share": "1 + b * done * chi / (1 - chi)",
                "rest_sinkage": "1 / (1 + a * done)",
            },
            needs=("contact_stiffness", "unloading_share", "rest_sinkage", "hop_index"),
        ),
    ),
)

FOOT_SLIP = Effect(
    physics_id="foot_slip",
    equation="ground_contact",
    mechanical=False,
    says="the foot slips sideways on a tilted push",
    sentence="On a tilt the foot slips beyond a friction of {mu}, yielding {s} times what the soil yields.",
    citation="J. Y. Wong, Theory of Ground Vehicles, 4th ed. (2008), ch. 2: shear displacement of loaded soil",
    forms=(
        Form(
            parameters=(
                EffectParameter("s", "1", "1", "0", "100", strength=True, least=0.0),
                EffectParameter("mu", "1", "0.1", "0", "1", least=0.0),
            ),
            # Vertical equivalent: what friction does not hold of the push shears the soil, in series with its
            # sinkage and for good: softer loading, the same unloading.
            local={
                "tilt": "tilt_deg * pi / 180",
                "unheld": "sin(abs(tilt)) * max(0, sin(abs(tilt)) - mu * cos(tilt))",
            },
            factors={
                "contact_stiffness": "1 / (1 + s * unheld)",
                "unloading_share": "1 / (1 + s * unheld)",
                "rest_sinkage": "1 + s * unheld",
            },
            needs=("contact_stiffness", "unloading_share", "rest_sinkage", "tilt_deg"),
        ),
    ),
)

EFFECTS = (SOIL_RATE, SOIL_HARDENING, ADDED_MASS, ADHESION, COMPACTION, FOOT_SLIP)
