"""Time of a scene, and protocols of an operation's tool."""

from __future__ import annotations

import math
import re
from dataclasses import MISSING, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

from ngbrain.schema.document import Section, entries
from ngbrain.schema.fields import choice, integer, number, text

if TYPE_CHECKING:
    from ngbrain.scene import Scene

MOST = 1000
"""Largest number of holds or stages of a protocol."""
MOMENT = 1e-5
"""Shortest step, ramp, hold or rest, relative to `Time.end`: with shorter ones a run would take too long."""
CLEAR = 1e-3
"""Distance (m) behind first contact to which a released tool is withdrawn."""


@dataclass(frozen=True, kw_only=True)
class Time(Section):
    """Time of a scene: loads grow linearly, or a tool advances, during `ramp`; then they are constant until `end`.

    Parameters
    ----------
    ramp
        Duration of the load ramp, or of the tool's travel.
    end
        End of the simulation, from the first load or the tool's first contact.
    frequency
        Of a harmonic load, in place of a ramp: displacements and tractions are its amplitudes.
    max_step_contact
        Longest time step of an operation while the tool pushes.
    max_step_hold
        Longest time step of an operation while the tool rests.
    step_tolerance
        Relative error of a time step in an operation: of the overstress of viscoelastic tissue, compared with two half steps.
    """

    ramp: float = number("ramp_s", 10.0)
    end: float = number("end_s", 900.0)
    frequency: float | None = number("frequency_Hz", None)
    max_step_contact: float = number("max_step_contact_s", 1.0)
    max_step_hold: float = number("max_step_hold_s", 60.0)
    step_tolerance: float = number("step_tolerance", 0.01)

    def _check(self, path: str, scene: Scene) -> None:
        self._need(1e-6 <= self.step_tolerance <= 0.1, path, "step_tolerance", "a relative error of 1e-6 to 0.1")
        if scene.cleft is None:
            self._need(self.end >= self.ramp, path, "end", f"at least {self.ramp:g}, time.ramp_s")
            return
        self._need(
            self.frequency is None, path, "frequency", "this key left out: an operation is not a harmonic problem"
        )
        self._need(self.end > self.ramp, path, "end", f"more than {self.ramp:g}, time.ramp_s")
        for name in ("ramp", "max_step_contact", "max_step_hold"):
            self._need(getattr(self, name) >= self.moment, path, name, self.not_shorter)

    @property
    def moment(self) -> float:
        """Shortest duration (s) of a step, ramp, hold or rest."""
        return MOMENT * self.end

    @property
    def not_shorter(self) -> str:
        """Text of the message on a shorter one."""
        return f"at least {self.moment:g}, time.end_s / {1 / MOMENT:g}"

    @property
    def in_words(self) -> str:
        """Its times, for messages on other values that have to fit."""
        return f"time.ramp_s = {self.ramp:g} and time.end_s = {self.end:g}"


@dataclass(frozen=True, kw_only=True)
class Protocol(Section):
    """Motion or force of the tool over time. Fields of other kinds are left out.

    Parameters
    ----------
    kind
        continuous: open, hold; intermittent: open, hold, release, open again, …; staged: open in equal steps with a rest after
        each, then hold; program: prescribed travel over time; force: prescribed force over time, with the travel as an unknown
        of at most `Tool.travel`.
    name
        The kind by default.
    hold
        Of an intermittent protocol: duration of a hold.
    rest
        From release to the next opening, or after each step of a staged protocol.
    stages
        Number of steps of a staged protocol.
    times
        Of a program or a force, with linear interpolation. A single force without times is reached in `Time.ramp` and held.
    travel
        Of a program, from first contact; negative values are clear of the tissue.
    force_gf
        Of a prescribed force, at its times; at 0 the tool is clear of the tissue.
    """

    KINDS: ClassVar = {"continuous": (), "intermittent": ("hold", "rest"), "staged": ("stages", "rest")}
    KINDS["program"] = ("times", "travel")
    KINDS["force"] = ("times", "force_gf")
    NAME: ClassVar = "up to 50 letters, digits, spaces and . + - _, of which the first is a letter or digit"

    kind: str = choice("kind", MISSING, KINDS)
    name: str = text("name", "", NAME, re.compile(r"\w[\w .+-]{0,49}").fullmatch)
    hold: float = number("hold_s", None)
    rest: float = number("rest_s", None)
    stages: int = integer("stages", None, 2, MOST)
    times: tuple[float, ...] = number("times_s", None, least=0.0, size=0)
    travel: tuple[float, ...] = number("travel_mm", None, signed=True, size=0)
    force_gf: tuple[float, ...] = number("force_gf", None, least=0.0, size=0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.kind if self.name == "" else self.name)
        super().__post_init__()

    def _check(self, path: str, scene: Scene) -> None:
        own = self.KINDS[self.kind]
        keys = ", ".join(entry.key for name, entry in entries(self).items() if name in ("kind", "name", *own))
        own = own[1:] if self.kind == "force" and not self.times else own
        for name in ("hold", "rest", "stages", "times", "travel", "force_gf"):
            wanted = f"{'a value' if name in own else 'this key left out'}: kind {self.kind!r} has {keys}"
            self._need((getattr(self, name) is not None) == (name in own), path, name, wanted)
        for name in ("hold", "rest"):
            long_enough = name not in own or getattr(self, name) >= scene.time.moment
            self._need(long_enough, path, name, scene.time.not_shorter)
        if self.kind == "intermittent":
            self._check_intermittent(path, scene)
        if self.kind == "staged":
            self._check_staged(path, scene.time)
        if self.kind == "program":
            self._check_program(path, scene.time)
        if self.kind == "force":
            self._check_force(path, scene)

    def _check_intermittent(self, path: str, scene: Scene) -> None:
        shared, tool = scene.time, scene.tool
        ramp, end = shared.ramp, shared.end
        cycle = ramp + self.hold + self.rest
        before = math.ceil(min(max((end * (1 - 1e-12) - ramp - self.hold) / cycle, 0), MOST))  # holds before the last
        wanted = f"a duration with which the run ends during a hold, the second to the {MOST}th"
        wanted += f", for rest_s = {self.rest:g}, {shared.in_words}"
        many = max(before, 2)
        exact = (end - many * ramp - (many - 1) * self.rest) / many
        wanted += f"; such as {math.ceil(1e3 * exact - 1e-6) / 1e3:.10g}" if before < MOST and exact > 1 else ""
        self._need(0 < before < MOST and before * cycle + ramp < end, path, "hold", wanted)
        least = ramp * (1 + 2 * CLEAR / tool.travel)
        wanted = f"more than {least:g}, the time for release and reopening"
        wanted += f" at tool.travel_mm = {tool.toml_value('travel'):g} in time.ramp_s = {ramp:g}"
        self._need(self.rest > least, path, "rest", wanted)

    def _check_staged(self, path: str, shared: Time) -> None:
        in_time = shared.ramp + (self.stages - 1) * self.rest < shared.end
        self._need(in_time, path, "rest", f"short enough for stages = {self.stages} with {shared.in_words}")
        most = math.floor(shared.ramp / shared.moment)
        self._need(self.stages <= most, path, "stages", f"at most {most}, for {shared.in_words}")

    def _check_program(self, path: str, shared: Time) -> None:
        self._check_times(path, shared)
        wanted = f"{len(self.times)} values, as many as times_s; the first 0, or less (clear of tissue), some greater"
        fits = len(self.travel) == len(self.times) and self.travel[0] <= 0 < max(self.travel)
        self._need(fits, path, "travel", wanted)

    def _check_force(self, path: str, scene: Scene) -> None:
        wanted = "another one with tool.kind = 'tube', whose force has no single direction"
        self._need(scene.tool.kind != "tube", path, "kind", wanted)
        if not self.times:
            self._need(
                len(self.force_gf) == 1 and self.force_gf[0] > 0, path, "force_gf", "one force above 0, or times_s too"
            )
            return
        self._check_times(path, scene.time)
        wanted = f"{len(self.times)} values, as many as times_s; the first 0, where the tool touches, some greater"
        fits = len(self.force_gf) == len(self.times) and self.force_gf[0] == 0 < max(self.force_gf)
        self._need(fits, path, "force_gf", wanted)

    def _check_times(self, path: str, shared: Time) -> None:
        rising = self.times[0] == 0 and all(b - a >= shared.moment for a, b in pairwise(self.times))
        wanted = f"times that start at 0, increase by {shared.moment:g} or more"
        wanted += f", and end at time.end_s = {shared.end:g}"
        self._need(rising and math.isclose(self.times[-1], shared.end), path, "times", wanted)

    def _check_wall(self, path: str, wall: float) -> None:
        wanted = f"none beyond {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(max(map(abs, self.travel or (0,))) <= wall, path, "travel", wanted)
