"""How the blade is driven: what all protocols share, and each of them."""

from __future__ import annotations

import math
import re
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

from ngbrain.fields import Section, choice, entries, number, text, whole

if TYPE_CHECKING:
    from ngbrain.scene import Scene

MOST = 1000
"""Holds or stages of a protocol."""
MOMENT = 1e-5
"""The shortest step, ramp, hold or rest, in `Retraction.elapsed`: with shorter ones a run would never end."""
CLEAR = 1e-3
"""How far (m) behind first contact a blade that let go waits."""


@dataclass(frozen=True, kw_only=True)
class Retraction(Section):
    """What all protocols share: how far the blade goes from first contact (m), how long that takes, the end (s)."""

    opening: float = number("opening_mm", 5e-3, least=0.01)
    ramp: float = number("ramp_s", 10.0)
    elapsed: float = number("elapsed_s", 900.0)

    def _check(self, path: str, scene: Scene) -> None:
        self._need(self.elapsed > self.ramp, path, "elapsed", f"more than {self.ramp:g}, retraction.ramp_s")
        self._need(self.ramp >= self.moment, path, "ramp", self.not_shorter)

    def _check_wall(self, path: str, wall: float) -> None:
        wanted = f"at most {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(self.opening <= wall, path, "opening", wanted)

    @property
    def moment(self) -> float:
        """The shortest time (s) that anything in a protocol may take, a step included."""
        return MOMENT * self.elapsed

    @property
    def not_shorter(self) -> str:
        """What a shorter one is told."""
        return f"at least {self.moment:g}, retraction.elapsed_s / {1 / MOMENT:g}"

    @property
    def in_words(self) -> str:
        """Its times, in messages about others that have to fit."""
        return f"retraction.ramp_s = {self.ramp:g} and retraction.elapsed_s = {self.elapsed:g}"


@dataclass(frozen=True, kw_only=True)
class Protocol(Section):
    """How the blade is driven; `name` is `kind` unless given. The fields of other kinds are None.

    continuous     open, hold
    intermittent   open, hold for `hold` s, let go, open again `rest` s after letting go, …
    staged         open in `stages` equal steps with `rest` s between them, hold
    program        the blade's way (m) `opening` from first contact at `times` (s), straight in between
    force          the blade's force (gf) `force_gf` at `times` (s), straight in between; its way is found, `Retraction.opening`
                   at most. One force alone is reached in `Retraction.ramp` and held. Without force the blade is off
    """

    KINDS: ClassVar = {"continuous": (), "intermittent": ("hold", "rest"), "staged": ("stages", "rest")}
    KINDS["program"] = ("times", "opening")
    KINDS["force"] = ("times", "force_gf")
    NAME: ClassVar = "up to 50 letters, digits, spaces and . + - _, of which the first is a letter or digit"

    kind: str = choice("kind", MISSING, KINDS)
    name: str = text("name", "", NAME, re.compile(r"\w[\w .+-]{0,49}").fullmatch)
    hold: float = number("hold_s", None)
    rest: float = number("rest_s", None)
    stages: int = whole("stages", None, 2, MOST)
    times: tuple[float, ...] = number("t_s", None, least=0.0, size=0)
    opening: tuple[float, ...] = number("opening_mm", None, signed=True, size=0)
    force_gf: tuple[float, ...] = number("force_gf", None, least=0.0, size=0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.kind if self.name == "" else self.name)
        super().__post_init__()

    def _check(self, path: str, scene: Scene) -> None:
        own = self.KINDS[self.kind]
        keys = ", ".join(entry.key for name, entry in entries(self).items() if name in ("kind", "name", *own))
        own = own[1:] if self.kind == "force" and not self.times else own
        for name in ("hold", "rest", "stages", "times", "opening", "force_gf"):
            wanted = f"{'a value' if name in own else 'this key left out'}: kind {self.kind!r} has {keys}"
            self._need((getattr(self, name) is not None) == (name in own), path, name, wanted)
        for name in ("hold", "rest"):
            long_enough = name not in own or getattr(self, name) >= scene.retraction.moment
            self._need(long_enough, path, name, scene.retraction.not_shorter)
        if self.kind == "intermittent":
            self._check_intermittent(path, scene.retraction)
        if self.kind == "staged":
            self._check_staged(path, scene.retraction)
        if self.kind == "program":
            self._check_program(path, scene.retraction)
        if self.kind == "force":
            self._check_force(path, scene)

    def _check_intermittent(self, path: str, shared: Retraction) -> None:
        ramp, end = shared.ramp, shared.elapsed
        cycle = ramp + self.hold + self.rest
        before = math.ceil(min(max((end * (1 - 1e-12) - ramp - self.hold) / cycle, 0), MOST))  # holds before the last
        wanted = f"holds of which one, not the first and of at most {MOST}, is under way at the end"
        wanted += f", for rest_s = {self.rest:g}, {shared.in_words}"
        many = max(before, 2)
        exact = (end - many * ramp - (many - 1) * self.rest) / many
        wanted += f"; such as {math.ceil(1e3 * exact - 1e-6) / 1e3:.10g}" if before < MOST and exact > 1 else ""
        self._need(0 < before < MOST and before * cycle + ramp < end, path, "hold", wanted)
        least = ramp * (1 + 2 * CLEAR / shared.opening)
        wanted = f"more than {least:g}, for the way back and forth"
        wanted += f" at retraction.opening_mm = {shared.shown('opening'):g} in retraction.ramp_s = {ramp:g}"
        self._need(self.rest > least, path, "rest", wanted)

    def _check_staged(self, path: str, shared: Retraction) -> None:
        in_time = shared.ramp + (self.stages - 1) * self.rest < shared.elapsed
        self._need(in_time, path, "rest", f"short enough for stages = {self.stages} with {shared.in_words}")
        most = math.floor(shared.ramp / shared.moment)
        self._need(self.stages <= most, path, "stages", f"at most {most}, for {shared.in_words}")

    def _check_program(self, path: str, shared: Retraction) -> None:
        self._check_times(path, shared)
        wanted = f"{len(self.times)} values, as many as t_s; the first 0, or less (clear of tissue), some greater"
        fits = len(self.opening) == len(self.times) and self.opening[0] <= 0 < max(self.opening)
        self._need(fits, path, "opening", wanted)

    def _check_force(self, path: str, scene: Scene) -> None:
        wanted = "another one with blade.kind = 'tube', whose force is not along one way"
        self._need(scene.blade.kind != "tube", path, "kind", wanted)
        if not self.times:
            self._need(
                len(self.force_gf) == 1 and self.force_gf[0] > 0, path, "force_gf", "one force above 0, or t_s too"
            )
            return
        self._check_times(path, scene.retraction)
        wanted = f"{len(self.times)} values, as many as t_s; the first 0, where the blade touches, some greater"
        fits = len(self.force_gf) == len(self.times) and self.force_gf[0] == 0 < max(self.force_gf)
        self._need(fits, path, "force_gf", wanted)

    def _check_times(self, path: str, shared: Retraction) -> None:
        rising = self.times[0] == 0 and all(b - a >= shared.moment for a, b in pairwise(self.times))
        wanted = f"times that start at 0, increase by {shared.moment:g} or more"
        wanted += f", and end at retraction.elapsed_s = {shared.elapsed:g}"
        self._need(rising and math.isclose(self.times[-1], shared.elapsed), path, "times", wanted)

    def _check_wall(self, path: str, wall: float) -> None:
        wanted = f"none beyond {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(max(map(abs, self.opening or (0,))) <= wall, path, "opening", wanted)


QUESTIONS = (
    "peak_pressure_mmHg",
    "peak_tip_pressure_mmHg",
    "peak_force_N",
    "dose_mmHg_min",
    *(f"{strain}_p{percent}" for strain in ("mps", "oss") for percent in (50, 95, 99)),
)
"""Numbers of a protocol's answer that an operation may be asked for."""


@dataclass(frozen=True, kw_only=True)
class Ask(Section):
    """A question about a protocol (the first one), with the relative error that its answer may have."""

    quantity: str = choice("quantity", QUESTIONS[0], QUESTIONS)
    protocol: str | None = text("protocol", None, "the name of a protocol", lambda raw: raw.strip())
    tolerance: float = number("tolerance", 0.1)

    def _check(self, path: str, scene: Scene) -> None:
        names = [protocol.name for protocol in scene.protocols]
        self._need(self.protocol in (None, *names), path, "protocol", f"one of {', '.join(names)}")
        self._need(1e-4 <= self.tolerance <= 1, path, "tolerance", "a relative error of 0.0001 to 1")

    @property
    def name(self) -> str:
        """Different for different questions."""
        return self.quantity + (f" of {self.protocol}" if self.protocol else "")
