"""The physical robot: nut, string, lock, springs, body, leg and soil.

Two plants take turns at the spring. While the lock holds the string the drive's plant says how far it is
compressed; from the lock's opening until the robot stands still the hop's plant does, started with the
compression at which the magnet was energised (the few milliseconds until the lock opens count as standing).
The drive's plant goes on all the time. The lock takes the string again when the nut is at home, the magnet is
off and the robot at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from sim_hal.coil import Coil
from sim_hal.drive import TensioningDrive
from sim_hal.hop import Hop, standing_reading_m_s2
from sim_hal.plant.plantfile import plant_document, read_plant
from sim_hal.plant.simulate import Plant
from sim_hal.settings import SimSettings, Spot
from sim_hal.truth import HopTruth, hop_truth

NUT, CURRENT, SPRING, ACCELERATION, MAGNET = (
    "nut_position_m",
    "motor_current_a",
    "spring_compression_m",
    "body_acceleration_m_s2",
    "magnet_current_a",
)
OF_DRIVE = NUT, CURRENT, SPRING

Truth = dict[str, Sequence[float] | float]
"""By channel the true values at the instants wanted of it, or the one that holds all the time."""


class World:
    """One robot on its ground. Time [s] goes on with `advance` only; commands hold until the next."""

    def __init__(self, settings: SimSettings, drive: Plant, hop: Plant) -> None:
        self._settings = settings
        self._hop_plant = hop
        self._spots = list(settings.spots)
        self._plants: dict[int, Plant] = {}
        self._hop: Hop | None = None
        self.now_s = self._drive_s = 0.0
        self.voltage_v = 0.0
        self.magnet_on = False
        self.latch_closed = settings.initial.latch_closed
        self.lock_blocked = False
        """Whether the lock is broken: it does not take the string any more."""
        self._ended: list[
            tuple[Spot, Callable[[], HopTruth]]
        ] = []  # hops, and what works out the truth of each
        self._truths: list[HopTruth] = []
        self._coil = Coil(hop)
        self._power_up_m = settings.initial.nut_position_m
        self._drive = TensioningDrive(
            drive, settings.rig, dict(settings.conditions), self._power_up_m, self.latch_closed
        )
        self._standing_m_s2 = standing_reading_m_s2(self.plant_here, self.conditions)

    @property
    def hops(self) -> list[HopTruth]:
        """The truth of each hop that has ended, worked out when it is first asked for."""
        self._truths += [truth() for _, truth in self._ended[len(self._truths) :]]
        return self._truths

    @property
    def hopping(self) -> bool:
        """Whether a hop has begun whose truth is not in `hops` yet."""
        return self._hop is not None

    @property
    def hop_plant(self) -> Plant:
        """The plant of the hop, with the true parameters."""
        return self._hop_plant

    @property
    def spot(self) -> Spot:
        """The ground under the present or the next hop."""
        return self._spots[self._at]

    def stand_on(self, spot: Spot) -> None:
        """Put other ground under the next hop and all after it: the robot was carried there, or leapt.

        A hop that has begun ends where it began. Raises `PlantError` for a parameter that the plant lacks.
        """
        made = len(self._ended) + self.hopping
        plant = plant_at(self._hop_plant, spot)
        self._spots[made:] = [*[self._spots[-1]] * (made - len(self._spots)), spot]
        self._plants = {at: known for at, known in self._plants.items() if at < made} | {made: plant}
        if not self.hopping:
            self._standing_m_s2 = standing_reading_m_s2(plant, self.conditions)

    @property
    def _at(self) -> int:
        return min(len(self._ended), len(self._spots) - 1)

    @property
    def plant_here(self) -> Plant:
        """The plant of the present or the next hop: the file's, with the values of its spot."""
        if self._at not in self._plants:
            self._plants[self._at] = plant_at(self._hop_plant, self.spot)
        return self._plants[self._at]

    @property
    def conditions(self) -> dict[str, float | str]:
        """Conditions of the present or the next hop, as a recording's sidecar states them."""
        earlier, spot = 0, self.spot
        while earlier < len(self._ended) and self._ended[-1 - earlier][0] == spot:
            earlier += 1
        return {
            **self._settings.conditions,
            "surface": spot.surface,
            "foot": float(spot.foot),
            "tilt_deg": spot.tilt_deg,
            "hop_index": float(earlier),
        }

    @property
    def nut_position_m(self) -> float:
        """True travel of the nut from where the latched string is just taut."""
        return self._drive.position_m

    @property
    def spring_compression_m(self) -> float:
        """True compression of the springs beyond the body's own weight."""
        if self._hop is not None and self._hop.opened:
            return self._hop.now(SPRING)
        return self._drive.spring_compression_m

    @property
    def at_home(self) -> bool:
        """Whether the nut presses the home switch."""
        return self._drive.position_m <= self._settings.rig.home_position_m

    @property
    def lock_is_due(self) -> bool:
        """Whether an open lock should take the string now."""
        return not self.latch_closed and self._hop is None and not self.magnet_on and self.at_home

    def set_voltage_v(self, voltage_v: float) -> None:
        """Apply a voltage to the motor from now on."""
        self.voltage_v = voltage_v

    def set_magnet(self, on: bool) -> None:
        """Energise the magnet, or take its supply, from now on."""
        if on == self.magnet_on:
            return
        self.magnet_on = on
        self._coil.switch(on, self.now_s, self._magnet_current_a(self.now_s))
        if on and self.latch_closed and self._hop is None:
            self._compression_m = self._drive.spring_compression_m
            self._hop = Hop(
                self.plant_here, self.conditions, self._compression_m, self.now_s, self._settings.rest
            )
        elif not on and self._hop is not None and not self._hop.opened:
            self._hop = None  # the lock has not let go: nothing has happened

    def advance(self, to_s: float, wanted: Mapping[str, Sequence[float]]) -> Truth:
        """Go on until `to_s` [s]; returns for each channel its true values at the wanted instants.

        Instants lie between the last advance and `to_s`, oldest first.
        """
        hop = self._hop
        if hop is None:
            truth = self._stand(to_s, wanted)
        else:
            truth = (self._fly if hop.opened else self._release)(hop, to_s, wanted)
            if hop.at_rest:
                self._end_hop(hop)
        if not self.latch_closed:
            self._close_latch_at_home()
        return truth

    def _stand(self, to_s: float, wanted: Mapping[str, Sequence[float]]) -> Truth:
        """Without a hop nothing moves but the drive; one that holds no spring is read on demand."""
        truth = self._look_at_drive(to_s, wanted, OF_DRIVE)
        truth[ACCELERATION] = self._standing_m_s2
        truth[MAGNET] = self._coil.currents_a(wanted[MAGNET])
        return truth

    def _look_at_drive(
        self, to_s: float, wanted: Mapping[str, Sequence[float]], channels: Sequence[str]
    ) -> Truth:
        """What the drive shows in the first channels of `OF_DRIVE` at the instants wanted of them, until `to_s`."""
        at_end = (to_s,)
        for channel in channels:
            if wanted[channel] != at_end:
                break
        else:  # nearly always: what samples the drive does so at the end of a tick
            self._drive_until(to_s)
            self.now_s = to_s
            return {name: (value,) for name, value in zip(channels, self._of_drive(), strict=False)}
        seen, of_drive = {}, {to_s, *wanted[NUT], *wanted[CURRENT]}
        for at_s in sorted(of_drive.union(*(wanted[channel] for channel in channels))):
            if self.latch_closed or at_s in of_drive:
                self._drive_until(at_s)
            seen[at_s] = self._of_drive()
            self.now_s = at_s
        return {name: [seen[at_s][place] for at_s in wanted[name]] for place, name in enumerate(channels)}

    def _of_drive(self) -> tuple[float, float, float]:
        """What the drive shows now, in the order of `OF_DRIVE`."""
        drive = self._drive
        return drive.position_m - self._power_up_m, drive.current_a, drive.spring_compression_m

    def _fly(self, hop: Hop, to_s: float, wanted: Mapping[str, Sequence[float]]) -> Truth:
        """With the lock open hop and drive have nothing to do with each other."""
        truth = self._look_at_drive(to_s, wanted, (NUT, CURRENT))
        if self.magnet_on and hop.start_s == self._coil.since_s:  # its current rises
            return truth | self._traced(hop, to_s, (SPRING, ACCELERATION, MAGNET), wanted)
        truth |= self._traced(hop, to_s, (SPRING, ACCELERATION), wanted)
        truth[MAGNET] = self._coil.currents_a(wanted[MAGNET])
        return truth

    def _traced(
        self, hop: Hop, to_s: float, channels: Sequence[str], wanted: Mapping[str, Sequence[float]]
    ) -> Truth:
        """Let the hop go on until `to_s` [s]; what it shows at the instants wanted of some channels."""
        instants = wanted[channels[0]]
        if any(wanted[channel] != instants for channel in channels):
            instants = sorted(set().union(*(wanted[channel] for channel in channels)))
        rows = hop.trace(instants if instants and instants[-1] >= to_s else (*instants, to_s))
        truth: Truth = {}
        for channel in channels:
            place = hop.places[channel]
            shown = [row[place] for row in rows]
            if wanted[channel] == instants:  # mostly they sample together
                truth[channel] = shown[: len(instants)]
            else:
                at = dict(zip(instants, shown, strict=False))
                truth[channel] = [at[at_s] for at_s in wanted[channel]]
        return truth

    def _release(self, hop: Hop, to_s: float, wanted: Mapping[str, Sequence[float]]) -> Truth:
        """While the magnet is to open the lock: look by look, for the drive holds the string until then."""
        seen, of_drive = {}, {to_s, *wanted[NUT], *wanted[CURRENT]}
        for at_s in sorted(of_drive.union(*wanted.values())):
            if at_s > self.now_s:
                if self.latch_closed or at_s in of_drive:
                    self._drive_until(at_s)
                hop.advance(at_s)
                if hop.opened and self.latch_closed:
                    self.latch_closed = False
                    self._drive.let_go()
                self.now_s = at_s
            seen[at_s] = {
                NUT: self._drive.position_m - self._power_up_m,
                CURRENT: self._drive.current_a,
                SPRING: self.spring_compression_m,
                ACCELERATION: hop.now(ACCELERATION) if hop.opened else self._standing_m_s2,
                MAGNET: self._magnet_current_a(at_s),
            }
        return {channel: [seen[at_s][channel] for at_s in instants] for channel, instants in wanted.items()}

    def _drive_until(self, at_s: float) -> None:
        """Let the drive go on until then, if it is not there yet."""
        if at_s > self._drive_s:
            self._drive.advance(at_s - self._drive_s, self.voltage_v)
            self._drive_s = at_s

    def _magnet_current_a(self, at_s: float) -> float:
        """The plant's own current while its magnet rises; the coil's once the supply was taken."""
        if self._hop is not None and self.magnet_on and self._hop.start_s == self._coil.since_s:
            return self._hop.now(MAGNET)
        return self._coil.current_a(at_s)

    def _end_hop(self, hop: Hop) -> None:
        truth = partial(
            hop_truth,
            self.plant_here,
            self.conditions,
            self._compression_m,
            hop=len(self._ended),
            spot=self.spot,
            fire_s=hop.start_s,
        )
        self._ended.append((self.spot, truth))
        self._hop = None
        self._standing_m_s2 = standing_reading_m_s2(self.plant_here, self.conditions)

    def _close_latch_at_home(self) -> None:
        if self.lock_is_due and not self.lock_blocked:
            self.latch_closed = True
            self._drive.hold_string()


def plant_at(plant: Plant, spot: Spot) -> Plant:
    """The hop's plant on a spot, checked as its file would be. Raises `PlantError` naming the parameter."""
    return read_plant(plant_document(plant.with_values(spot.values)), plant.source) if spot.values else plant
