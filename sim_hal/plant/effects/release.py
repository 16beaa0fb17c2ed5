"""Effects of the lock's opening."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectMemory, EffectParameter, Form

RELEASE_DELAY = Effect(
    physics_id="release_delay",
    equation="latch",
    mechanical=False,
    says="the lock opens later than its trip current",
    sentence="The lock opens {delay} later than its trip current.",
    citation="H. C. Roters, Electromagnetic Devices (1941), ch. 12: travel time of the armature",
    forms=(
        Form(
            parameters=(EffectParameter("delay", "s", "0.001", "0", "0.05", strength=True, least=0.0),),
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
                EffectParameter("F_d", "N", "5", "0", "500", strength=True, least=0.0),
                EffectParameter("t_f", "s", "0.01", "0.0005", "0.1", above=0.0),
            ),
            # v is the compression's rate: the drag acts only while the leg extends, or rests and is about to: a force
            # that jumps just behind the start of a step costs many tiny ones.
            force="where(opened and v <= 0, F_d * max(0, 1 - since(opened) / t_f), 0)",
            needs=("opened",),
        ),
    ),
)

REEL_INERTIA = Effect(
    physics_id="reel_inertia",
    equation="latch",
    balances=("sleeve",),
    mechanical=False,
    says="the reel and string spin up with the release and take energy",
    sentence="Reel and string move with the extending leg like a mass of {m_r} until they overrun it.",
    citation="J. J. Uicker et al., Theory of Machines and Mechanisms (2011), ch. 14: equivalent mass J/r²",
    forms=(
        Form(
            parameters=(EffectParameter("m_r", "kg", "0.02 * m_l", "0", "m_l", strength=True, least=0.0),),
            # A string only pulls: the reel keeps the fastest speed so far, and its energy with it.
            memories={"reel_speed": EffectMemory("m/s", "v_b - v_l", None, "0")},
            inertia="where(v_b - v_l >= reel_speed, m_r, 0)",
            needs=("opened", "v_b", "v_l"),
        ),
    ),
)

EFFECTS = (RELEASE_DELAY, LATCH_DRAG, REEL_INERTIA)
