"""One attempt at one trial, which begins and ends with the lifted drum, and its table row."""

from __future__ import annotations

from rigctl.acquisition.drum.motion import DrumMotion
from rigctl.acquisition.drum.settings import trial_settings
from rigctl.acquisition.protocol.trial_quality import MeasuredTrial, judge, measure, trial_row
from rigctl.acquisition.taxels.pipeline import SamplePipeline
from rigctl.acquisition.taxels.trial_cutter import CutTrial
from rigctl.acquisition.taxels.trial_start_by_clock import TrialStart, estimate_trial_start
from rigctl.devices.clock_fit import ClockEstimate
from rigctl.errors import RigFault
from rigctl.protocol.plan import Quality
from rigctl.values import DrumState, LoadcellSample, PlannedTrial, TrialRow, Verdict

LATE_SAMPLES_TIMEOUT_S = 1.0
MAX_CLOCK_ERROR_PPM = 100.0
MIN_CLOCK_SPAN_S = 5.0
CLOCK_TIMEOUT_S = 30.0


class TrialAttempt:
    """Moves, presses, runs, cuts and judges one trial. Use once; :meth:`row` is always valid."""

    def __init__(
        self,
        motion: DrumMotion,
        pipeline: SamplePipeline,
        trial: PlannedTrial,
        number: int,
        quality: Quality,
    ) -> None:
        self.trial = trial
        self.number = number
        self.start_by_clock: TrialStart | None = None
        self._motion = motion
        self._poller = motion.poller
        self._pipeline = pipeline
        self._quality = quality
        self._now_s = motion.poller.loop.time
        self._started_s = self._now_s()
        self._loadcell: list[LoadcellSample] = []
        self._measured = MeasuredTrial()
        self._cut: CutTrial | None = None
        self._by_wire = motion.config.signals.sync
        self._rises_before: int | None = None

    async def run(self) -> tuple[str, ...]:
        """Record the trial, begin the lift, and return the reasons against it, none if it is good.

        Raises what ``motion.check`` raises, and RigFault.
        """
        unsubscribe = self._poller.subscribe(self._add_state)
        try:
            await self._prepare()
            await self._press_and_turn()
        finally:
            unsubscribe()
            self._pipeline.flush()
            self._cut = self._pipeline.trial_cutter.trial
            self._pipeline.trial_cutter.cancel()
        return judge(self.trial, self._cut, self._measured, self._quality)

    def row(self, verdict: Verdict, reasons: tuple[str, ...]) -> TrialRow:
        """Return the attempt's row; the recorder fills in part and first sample."""
        times_s = self._started_s, self._now_s()
        return trial_row(
            self.trial, self.number, verdict, reasons, self._cut, self._measured, *times_s
        )

    async def _prepare(self) -> None:
        await self._motion.write_settings(**trial_settings(self.trial, self._motion.config.drum))
        await self._motion.move_to_start(self.trial)
        self._pipeline.flush()
        self._pipeline.trial_cutter.expect(self.trial.n_samples, self._by_wire)

    async def _press_and_turn(self) -> None:
        motion = self._motion
        await motion.approach()
        await self._wait_for_clocks()
        await motion.trim_clock()
        self._rises_before = rises_before = self._poller.healthy_state().sync_count
        state = await motion.run()
        await motion.begin_lift()
        if state.sync_count == rises_before:
            raise RigFault("the drum ran without raising its sync line: load its firmware again")
        self._measured = measure(
            self.trial,
            state,
            self._loadcell,
            motion.settings["travel_set"],
            self._poller.clock_fit.ppm or 0.0,
        )
        await self._wait_for_samples()

    async def _wait_for_clocks(self) -> None:
        """Wait until the clock errors are known well enough for a true speed and a cut."""
        end_s = self._now_s() + CLOCK_TIMEOUT_S
        fits = {"drum": self._poller.clock_fit}
        if not self._by_wire:
            fits["taxel board"] = self._pipeline.clock_fit
        while unknown := [board for board, fit in fits.items() if not _is_known(fit.estimate)]:
            if self._now_s() > end_s:
                raise RigFault(
                    f"the {unknown[0]}'s clock cannot be fitted because its data arrive too "
                    "unevenly: give the board a USB port of its own"
                )
            await self._poller.wait_cycle()
            self._motion.check()

    async def _wait_for_samples(self) -> None:
        """Give the window's last samples time to arrive; lost ones are judged, not awaited."""
        end_s = self._now_s() + LATE_SAMPLES_TIMEOUT_S
        while not self._is_cut() and self._now_s() < end_s:
            await self._poller.wait_cycle()
            self._motion.check()

    def _is_cut(self) -> bool:
        self._pipeline.flush()
        cut = self._pipeline.trial_cutter.trial
        return cut is not None and cut.complete

    def _add_state(self, state: DrumState) -> None:
        self._loadcell.extend(state.loadcell)
        rose = self._rises_before is not None and state.sync_count != self._rises_before
        if rose and not self._by_wire and self.start_by_clock is None:
            self._cut_by_clock(state)

    def _cut_by_clock(self, state: DrumState) -> None:
        """Cut at the rise's time on the drum: no wire shows it to the taxel board."""
        self._pipeline.flush()
        self.start_by_clock = estimate_trial_start(
            state.sync_rise_us, self._poller.clock_fit, self._pipeline.clock_fit
        )
        if self.start_by_clock is not None:
            self._pipeline.trial_cutter.begin(self.start_by_clock.first_counter)


def _is_known(estimate: ClockEstimate | None) -> bool:
    return (
        estimate is not None
        and estimate.span_s >= MIN_CLOCK_SPAN_S
        and estimate.error_ppm <= MAX_CLOCK_ERROR_PPM
    )
