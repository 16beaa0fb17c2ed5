"""Electrical and transmission effects of the tensioning drive, and what its string does under load."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectMemory, EffectParameter, EffectState, Form

WINDING_HEATING = Effect(
    physics_id="winding_heating",
    equation="electrical",
    mechanical=False,
    says="winding resistance rises with the heat put in",
    sentence="The winding warms ({R_th} to the air, capacity {C_th}); its resistance rises by {alpha}.",
    citation="maxon motor data sheets: copper 0.0039 1/K, thermal resistance and capacity of the winding",
    forms=(
        Form(
            parameters=(
                EffectParameter("alpha", "1/K", "0.0039", "0", "0.02", strength=True),
                EffectParameter("R_th", "K/W", "25", "2", "200"),
                EffectParameter("C_th", "J/K", "0.3", "0.01", "10"),
            ),
            states={"dT": EffectState("K", "(resistance * i ** 2 - dT / R_th) / C_th")},
            factors={"resistance": "1 + alpha * dT"},
            needs=("resistance", "i"),
        ),
    ),
)

BRUSH_DROP = Effect(
    physics_id="brush_voltage_drop",
    equation="electrical",
    balances=("electrical",),
    mechanical=False,
    says="brushes drop a voltage that only the current's sign changes",
    sentence="The brushes drop {U_b} against the current.",
    citation="A. Hughes, Electric Motors and Drives, 5th ed. (2019), ch. 3",
    forms=(
        Form(
            parameters=(EffectParameter("U_b", "V", "0.1", "0", "3", strength=True),),
            dry=("U_b", "U_b"),
            needs=("terminal_voltage",),
        ),
    ),
)

SUPPLY_SAG = Effect(
    physics_id="supply_sag",
    equation="electrical",
    mechanical=False,
    says="the supply has a source resistance, so the voltage drops with current",
    sentence="The supply of {U_s} has a source resistance of {R_s} behind the bridge.",
    citation="averaged model of a pulse-width modulated bridge: supply current = duty · motor current",
    forms=(
        Form(
            parameters=(
                EffectParameter("R_s", "ohm", "0.2", "0", "5", strength=True),
                EffectParameter("U_s", "V", "12", "12", "12", constant=True),
            ),
            terms={"terminal_voltage": "-R_s * i * (motor_voltage_v / U_s) ** 2"},
            needs=("terminal_voltage", "motor_voltage_v", "i"),
        ),
    ),
)

DEAD_TIME = Effect(
    physics_id="dead_time",
    equation="electrical",
    mechanical=False,
    says="the bridge gives nothing below a threshold voltage",
    sentence="The bridge gives nothing below {U_d} and that much less above it.",
    citation="S.-G. Jeong, M.-H. Park, IEEE Trans. Ind. Electron. 38 (1991) 108",
    forms=(
        Form(
            parameters=(EffectParameter("U_d", "V", "0.2", "0", "3", strength=True),),
            terms={"terminal_voltage": "-max(-U_d, min(U_d, motor_voltage_v))"},
            needs=("terminal_voltage", "motor_voltage_v"),
        ),
    ),
)

CONSTANT_SATURATION = Effect(
    physics_id="torque_constant_saturation",
    equation="electrical",
    mechanical=False,
    says="the torque constant falls at high current",
    sentence="The torque constant falls with the current as 1/(1 + s i²), s = {saturation}.",
    citation="A. Hughes, Electric Motors and Drives, 5th ed. (2019), ch. 3: saturation of the iron",
    forms=(
        Form(
            parameters=(EffectParameter("saturation", "1/A**2", "0.05", "0", "4", strength=True),),
            factors={"motor_constant": "1 / (1 + saturation * i ** 2)"},
            needs=("motor_constant", "i"),
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
                EffectParameter("compliance", "m/N", "0.1 / k_m", "0", "5 / k_m", strength=True),
                EffectParameter("tau", "s", "3", "0.05", "60"),
            ),
            states={"x_c": EffectState("m", "(string_force * compliance - x_c) / tau")},
            terms={"extension": "-x_c"},
            needs=("extension", "string_force"),
        ),
    ),
)

BACKLASH = Effect(
    physics_id="backlash",
    equation="transmission",
    mechanical=False,
    says="lost motion at each reversal",
    sentence="{width} of travel is lost at each reversal.",
    citation="M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633",
    forms=(
        Form(
            parameters=(EffectParameter("width", "m", "0.0001", "0", "0.003", strength=True),),
            # The forward flank is engaged at the start; in the gap the nut holds its place.
            memories={"nut": EffectMemory("m", "r * theta", "r * theta + width", "nut_position_m")},
            terms={"travel": "nut - r * theta"},
            needs=("travel", "theta", "r"),
        ),
    ),
)

EFFECTS = (
    WINDING_HEATING,
    BRUSH_DROP,
    SUPPLY_SAG,
    DEAD_TIME,
    CONSTANT_SATURATION,
    STRING_CREEP,
    BACKLASH,
)
