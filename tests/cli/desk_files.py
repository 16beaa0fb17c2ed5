"""A sound recording and a sound plant, as a person has them lying in a folder."""

from __future__ import annotations

TABLE = "time_s,force_n,position_m\n0.0,1.0,0.0\n0.1,1.0,0.5\n0.2,1.0,1.5\n"
SIDECAR = "format: 1\nrun: a\nrig: cart\nkind: axis\n"
PLANT = """\
format: 1
name: cart
kind: equations
inputs: {force_n: N}
states:
  q: {unit: m, initial: 0}
  v: {unit: m/s, initial: 0}
parameters:
  mass: {value: 2.0, std: 0.2, unit: kg}
equations:
  kinematics: {state: q, rate: "v"}
  balance: {state: v, rate: "force_n / mass", balance: true, per_force: "1 / mass", velocity: v, position: q}
outputs:
  position_m: {value: "q"}
"""
