"""Effects in the circuit of the tensioning drive: supply, bridge, brushes and winding."""

from __future__ import annotations

from sim_hal.plant.effects.base import Effect, EffectParameter, EffectState, Form

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
                EffectParameter("alpha", "1/K", "0.0039", "0", "0.02", strength=True, least=0.0),
                EffectParameter("R_th", "K/W", "25", "2", "200", above=0.0),
                EffectParameter("C_th", "J/K", "0.3", "0.01", "10", above=0.0),
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
            parameters=(EffectParameter("U_b", "V", "0.1", "0", "3", strength=True, least=0.0),),
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
                EffectParameter("R_s", "ohm", "0.2", "0", "5", strength=True, least=0.0),
                EffectParameter("U_s", "V", "12", "12", "12", constant=True, above=0.0),
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
            parameters=(EffectParameter("U_d", "V", "0.2", "0", "3", strength=True, least=0.0),),
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
            parameters=(EffectParameter("saturation", "1/A**2", "0.05", "0", "4", strength=True, least=0.0),),
            factors={"motor_constant": "1 / (1 + saturation * i ** 2)"},
            needs=("motor_constant", "i"),
        ),
    ),
)

EFFECTS = (WINDING_HEATING, BRUSH_DROP, SUPPLY_SAG, DEAD_TIME, CONSTANT_SATURATION)
