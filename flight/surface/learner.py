"""What the robot keeps of the ground over places, missions and restarts: the belief of now, and surfaces it met."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from flight.surface.belief import probabilities, said_of
from flight.surface.known import UNKNOWN, SurfaceSettings
from flight.surface.mixture import FALL, LOSS, STIFFNESS, Mixture, arrays_of
from flight.surface.priors import SurfaceModel
from flight.surface.settings import SurfaceLearning
from flight.surface.tracker import GroundModels, Run, Tracker

LEARNED = "new_surface_"
FORMAT = 1
_PRIOR_PLACES = 2.0  # places that the spread expected of a new surface counts for, once its own show another
_SPREAD = 0.18  # of u from place to place of one surface, as a share: the middle of the published ones


@dataclass(frozen=True)
class LearnedSurface:
    """A surface that no table has, by the places met of it: sums of u, its square, its fall, ln stiffness."""

    name: str
    foot: str
    tilt_deg: float
    places: int
    sum_loss: float
    sum_loss_square: float
    sum_fall: float
    sum_log_stiffness: float

    def model(self, settings: SurfaceLearning) -> SurfaceModel:
        """Places to expect of it: the spread of published surfaces, until its own places tell."""
        count, learning = float(self.places), settings.learning
        loss = self.sum_loss / count
        scatter = max(self.sum_loss_square - count * loss**2, 0.0)
        expected = (_SPREAD * max(abs(loss), 0.1)) ** 2
        variance = (_PRIOR_PLACES * expected + scatter) / (_PRIOR_PLACES + count - 1.0)
        wider = math.sqrt(1.0 + 1.0 / count)  # the mean itself is known from so many places only
        return SurfaceModel(
            name=self.name,
            loss=loss,
            loss_std=math.sqrt(variance) * wider,
            fall=self.sum_fall / count,
            fall_std=learning.fall_std * wider,
            log_stiffness=self.sum_log_stiffness / count,
            log_stiffness_std=learning.stiffness_place_std * wider,
            hop_std=max(learning.hop_share * math.sqrt(variance), learning.least_hop_std),
        )

    def with_place(self, loss: float, fall: float, log_stiffness: float) -> LearnedSurface:
        """With one more place."""
        return replace(
            self,
            places=self.places + 1,
            sum_loss=self.sum_loss + loss,
            sum_loss_square=self.sum_loss_square + loss**2,
            sum_fall=self.sum_fall + fall,
            sum_log_stiffness=self.sum_log_stiffness + log_stiffness,
        )


def learned_from(
    tracker: Tracker, foot: str, tilt_deg: float, learned: Sequence[LearnedSurface]
) -> tuple[LearnedSurface, ...]:
    """The learned surfaces once the tracker's present spot is left: a new one, one met again, or as they were."""
    run = max(tracker.runs, key=lambda each: each.log_weight)
    said = said_of(tracker, probabilities(tracker))
    known = [surface.name for surface in learned]
    if tracker.hops - run.start < tracker.ground.settings.decision.least_hops_to_learn:
        return tuple(learned)
    if said != UNKNOWN and said not in known:
        return tuple(learned)
    own = run.mixture.chosen(run.mixture.surfaces == tracker.ground.names.index(said))
    loss, fall = own.moments(LOSS)[0], own.moments(FALL)[0]
    place = (loss, fall / loss if abs(loss) > 0.05 else 0.0, own.moments(STIFFNESS)[0])
    if said == UNKNOWN:
        fresh = LearnedSurface(f"{LEARNED}{len(learned) + 1}", foot, tilt_deg, 0, 0.0, 0.0, 0.0, 0.0)
        return (*learned, fresh.with_place(*place))
    return tuple(s.with_place(*place) if s.name == said else s for s in learned)


@dataclass(frozen=True)
class GroundRecord:
    """What outlives the power: the learned surfaces, and the belief with the foot and tilt it was had with."""

    learned: tuple[LearnedSurface, ...] = ()
    tracker: Tracker | None = None
    foot: str = ""
    tilt_deg: float = 0.0


def to_text(record: GroundRecord) -> str:
    """The record as text; numbers keep all their bits."""
    tracker = record.tracker
    content: dict[str, Any] = {
        "format": FORMAT,
        "learned": [asdict(surface) for surface in record.learned],
        "foot": record.foot,
        "tilt_deg": record.tilt_deg,
        "tracker": None
        if tracker is None
        else {
            "names": list(tracker.ground.names),
            "dose": tracker.dose,
            "hops": tracker.hops,
            "runs": [
                {
                    "start": run.start,
                    "dose": run.dose,
                    "log_weight": run.log_weight,
                    "mixture": {name: _packed(value) for name, value in arrays_of(run.mixture).items()},
                }
                for run in tracker.runs
            ],
        },
    }
    return json.dumps(content)


def from_text(text: str, surfaces: SurfaceSettings, settings: SurfaceLearning) -> GroundRecord:
    """The record in a text. Raises `ValueError` when it is none, or does not fit the surfaces known now."""
    try:
        content = json.loads(text)
        if content["format"] != FORMAT:
            raise ValueError(f"format {content['format']!r} is not {FORMAT}")
        learned = tuple(LearnedSurface(**each) for each in content["learned"])
        foot, tilt_deg = str(content["foot"]), float(content["tilt_deg"])
        tracker = None
        if content["tracker"] is not None:
            of_then = [surface for surface in learned if surface.name in content["tracker"]["names"]]
            ground = models_of(surfaces, settings, foot, tilt_deg, of_then)
            tracker = _tracker(content["tracker"], ground)
    except (KeyError, TypeError, AttributeError, zlib.error) as error:
        raise ValueError(f"the record of the ground is damaged ({error!r})") from error
    return GroundRecord(learned, tracker, foot, tilt_deg)


def models_of(
    surfaces: SurfaceSettings,
    settings: SurfaceLearning,
    foot: str,
    tilt_deg: float,
    learned: Sequence[LearnedSurface],
) -> GroundModels:
    """All ground that may be met with a foot and tilt, surfaces learned with the same foot and tilt among it."""
    same = [s.model(settings) for s in learned if s.foot == foot and abs(s.tilt_deg - tilt_deg) < 0.5]
    return GroundModels.of(surfaces, settings, foot, tilt_deg, same)


def _tracker(content: Mapping[str, Any], ground: GroundModels) -> Tracker:
    if tuple(content["names"]) != ground.names:
        raise ValueError("the record of the ground is of other surfaces than those known now")
    runs = tuple(
        Run(
            int(run["start"]),
            float(run["dose"]),
            float(run["log_weight"]),
            Mixture(**{name: _unpacked(value) for name, value in run["mixture"].items()}),
        )
        for run in content["runs"]
    )
    return Tracker(ground, runs, float(content["dose"]), int(content["hops"]))


def _packed(array: np.ndarray[Any, np.dtype[Any]]) -> dict[str, Any]:
    """An array as text: kind, shape, and its bytes, compressed."""
    kind = "i8" if array.dtype.kind == "i" else "f8"
    data = zlib.compress(np.ascontiguousarray(array, dtype=f"<{kind}").tobytes())
    return {"kind": kind, "shape": list(array.shape), "data": base64.b64encode(data).decode()}


def _unpacked(content: Mapping[str, Any]) -> np.ndarray[Any, np.dtype[Any]]:
    kind = {"i8": np.int64, "f8": np.float64}[content["kind"]]
    data = zlib.decompress(base64.b64decode(content["data"]))
    return np.frombuffer(data, dtype=np.dtype(kind).newbyteorder("<")).astype(kind).reshape(content["shape"])
