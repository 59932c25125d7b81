"""One attempt at one trial: from the lifted drum to the lifted drum, with a row to show for it."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.protocol.trial_quality import (
    MeasuredTrial,
    QualityLimits,
    TrialWindow,
    judge,
    measure,
)
from rigctl.acquisition.taxels.clock_fit import ClockEstimate
from rigctl.acquisition.taxels.pipeline import SamplePipeline
from rigctl.acquisition.taxels.trial_cutter import CutTrial
from rigctl.acquisition.taxels.trial_start_by_clock import TrialStart, place_of
from rigctl.errors import RigFault
from rigctl.values import DrumState, LoadcellSample, PlannedTrial, TrialRow, Verdict

LATE_DATA_LIMIT_S = 1.0
TRAVEL_SLACK_S = 10.0
TRAVEL_SLACK = 1.5
CLOCK_ERROR_PPM = 100.0
CLOCK_SPAN_S = 5.0
CLOCK_LIMIT_S = 30.0


class TrialAttempt:
    """Moves, presses, runs, cuts, judges. Use once; :meth:`row` is valid at any time."""

    def __init__(
        self,
        motion: DrumMotion,
        pump: SamplePipeline,
        trial: PlannedTrial,
        number: int,
        limits: QualityLimits,
    ) -> None:
        self.trial = trial
        self.number = number
        self._motion = motion
        self._pump = pump
        self._limits = limits
        self._now_s: Callable[[], float] = motion.watch.loop.time
        self._started_s = self._now_s()
        self._loadcell: list[LoadcellSample] = []
        self._measured = MeasuredTrial()
        self._cut: CutTrial | None = None
        self._by_wire = motion.config.signals.sync
        self._rises: int | None = None
        self.place: TrialStart | None = None

    async def run(self) -> tuple[str, ...]:
        """Take the trial; reasons against it, none when it is good. Ends with the lift begun.

        Raises what ``motion.check`` raises, and RigFault.
        """
        unwatch = self._motion.watch.watch(self._note)
        try:
            await self._prepare()
            await self._touch_and_turn()
        finally:
            unwatch()
            self._pump.flush()
            self._cut = self._pump.cutter.trial
            self._pump.cutter.forget()
        return judge(self.trial, self._cut, self._measured, self._limits)

    def row(self, verdict: Verdict, reasons: tuple[str, ...]) -> TrialRow:
        """The attempt as it is stored; the recorder fills in part and first sample."""
        cut = self._cut
        return TrialRow(
            trial=self.trial,
            attempt=self.number,
            part=0,
            first_counter=cut.first_counter if cut else -1,
            first_sample=-1,
            count=cut.n_samples if cut else 0,
            verdict=verdict,
            reasons=reasons,
            started_s=self._started_s,
            ended_s=self._now_s(),
            mean_speed_mm_s=self._measured.mean_speed_mm_s,
            mean_force_g=self._measured.mean_force_g,
        )

    async def _prepare(self) -> None:
        await self._motion.set_trial(self.trial)
        await self._motion.move_to_start(self.trial)
        self._pump.flush()
        self._pump.cutter.expect(self.trial.n_samples, self._by_wire)

    async def _touch_and_turn(self) -> None:
        motion = self._motion
        await motion.approach()
        await self._set_clock()
        self._rises = rises = motion.watch.healthy().sync_count
        state = await motion.run(self._travel_limit_s())
        await motion.begin_lift()
        if state.sync_count == rises:
            raise RigFault("the drum ran without raising its sync line: load its firmware anew")
        self._measured = measure(self.trial, self._window(state))
        await self._await_samples()

    async def _set_clock(self) -> None:
        """Wait until clock errors are known well enough for a true speed and a cut."""
        watch = self._motion.watch
        late_s = self._now_s() + CLOCK_LIMIT_S
        while (name := self._unknown_clock()) is not None:
            if self._now_s() > late_s:
                raise RigFault(
                    f"the {name}'s clock cannot be followed, its data come too unevenly: "
                    "give the board a USB port of its own"
                )
            await watch.turn()
            self._motion.check()
        await self._motion.trim()

    def _unknown_clock(self) -> str | None:
        """Board whose clock is not known well enough yet; the sync line spares the taxels'."""
        if not _is_known(self._motion.watch.clock.estimate):
            return "drum"
        if not self._by_wire and not _is_known(self._pump.clock.estimate):
            return "taxel board"
        return None

    async def _await_samples(self) -> None:
        """Give the last samples of the window time to arrive; a lost one is judged, not awaited."""
        late_s = self._now_s() + LATE_DATA_LIMIT_S
        while not self._is_cut() and self._now_s() < late_s:
            await self._motion.watch.turn()
            self._motion.check()

    def _is_cut(self) -> bool:
        self._pump.flush()
        cut = self._pump.cutter.trial
        return cut is not None and cut.complete

    def _window(self, state: DrumState) -> TrialWindow:
        travel_mm = self._motion.settings["travel_set"]
        ppm = clock_ppm(self._motion.watch.clock.estimate)
        return TrialWindow(travel_mm, state.sync_rise_us, state.sync_fall_us, ppm, self._loadcell)

    def _travel_limit_s(self) -> float:
        travel_mm = self._motion.config.drum.run_in_mm + self.trial.travel_mm
        return TRAVEL_SLACK_S + TRAVEL_SLACK * travel_mm / self.trial.speed_mm_s

    def _note(self, state: DrumState) -> None:
        self._loadcell.extend(state.loadcell)
        rose = self._rises is not None and state.sync_count != self._rises
        if rose and not self._by_wire and self.place is None:
            self._cut_by_clock(state)

    def _cut_by_clock(self, state: DrumState) -> None:
        """No wire shows the rise to the taxel board: the drum said when it was."""
        self._pump.flush()
        self.place = place_of(state.sync_rise_us, self._motion.watch.clock, self._pump.clock)
        if self.place is not None:
            self._pump.cutter.begin(self.place.first_counter)


def _is_known(estimate: ClockEstimate | None) -> bool:
    return (
        estimate is not None
        and estimate.span_s >= CLOCK_SPAN_S
        and estimate.error_ppm <= CLOCK_ERROR_PPM
    )


def clock_ppm(estimate: ClockEstimate | None) -> float:
    """What is known of a clock's error, 0 where nothing is."""
    return 0.0 if estimate is None else estimate.ppm
