"""One attempt at a trial: wait for the slide, scan between the marks, measure and judge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigFault
from rigctl.finger.board_messages import BatchReport, Message, WindowReport
from rigctl.finger.control import FingerControl
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.devices import FingerDevices
from rigctl.finger.plan import ScanQuality
from rigctl.finger.rig import FingerRig
from rigctl.finger.scan_in_progress import ScanInProgress
from rigctl.finger.scan_quality import ScanMeasures, judge_scan, measure_scan
from rigctl.finger.scan_recording import ScanOutput
from rigctl.finger.slide_detector import SlideDetector, SlideState, contact_share
from rigctl.finger.trackers.plate_frame import PlatePosition
from rigctl.finger.values import FingerTrial
from rigctl.values import Position

END_TIMEOUT_S = 1.0
"""Longest wait for the board's last windows after the scan."""
SLIDE_TIMEOUT_S = 10.0
"""A simulated operator who has not passed the first mark by then has not made the slide."""


class ScanAttempt:
    """One attempt; use once. ``output`` takes what the scan produces."""

    def __init__(
        self,
        trial: FingerTrial,
        number: int,
        rig: FingerRig,
        devices: FingerDevices,
        output: ScanOutput,
    ) -> None:
        self.trial = trial
        self.scan: ScanInProgress | None = None
        self.measures = ScanMeasures()
        self.started_s = rig.loop.time()
        self._number = number
        self._rig = rig
        self._devices = devices
        self._output = output
        self._restarts = devices.restarts
        self._detector = SlideDetector()
        self._positions_s: list[float] = []
        self._pressed: list[NDArray[np.bool_]] = []
        self._failure = ""

    @property
    def scanning(self) -> bool:
        """Whether the finger is between the marks."""
        return self._detector.state is SlideState.INSIDE

    async def run(self, control: FingerControl, quality: ScanQuality) -> tuple[str, ...]:
        """Make the scan; return the reasons against it, none if it is good.

        Raises what ``control.check`` raises; the scan is then broken off.
        """
        unsubscribe = self._devices.subscribe(
            self._take_block, self._take_message, self._take_position
        )
        try:
            await control.wait_until(lambda: not self._rig.sliding)
            self._rig.slide(self.trial)
            await self._wait_for_end(control)
        finally:
            if self.scan is not None and not self.scan.ended:
                self._stop()
            unsubscribe()
        return self._judge(quality)

    async def _wait_for_end(self, control: FingerControl) -> None:
        limit_s = self.started_s + SLIDE_TIMEOUT_S
        await control.wait_until(lambda: self.scan is not None or self._gave_up(limit_s))
        if self.scan is None:
            return
        await control.wait_until(self._is_over)
        limit_s = self._rig.loop.time() + END_TIMEOUT_S
        await control.wait_until(lambda: self._has_ended() or self._rig.loop.time() > limit_s)
        await control.wait_until(lambda: not self._rig.sliding)

    def _gave_up(self, limit_s: float) -> bool:
        """Return whether a simulated operator ended without a scan; people take their time."""
        if self._failure:
            return True
        over = not self._rig.sliding and self._rig.loop.time() > limit_s
        return self._rig.simulated and over

    def _is_over(self) -> bool:
        """Return whether the finger or the board ended the scan; a silent tracker ends it, too."""
        self._follow(self._detector.check_silence(self._rig.loop.time()))
        return not self.scanning or self._has_ended()

    def _has_ended(self) -> bool:
        """Return whether nothing more comes from the board."""
        self._guarded_send()
        return self.scan is None or self.scan.ended or self._board_restarted

    @property
    def _board_restarted(self) -> bool:
        return self._devices.restarts != self._restarts

    def _judge(self, quality: ScanQuality) -> tuple[str, ...]:
        scan = self.scan
        if scan is None:
            return (self._failure or "the finger did not pass the first mark",)
        if scan.data.count:
            share = contact_share(np.concatenate(self._pressed))
            self.measures = measure_scan(scan.data, self._positions_s, share)
        broken = self._broken(scan)
        return (broken,) if broken else judge_scan(self.trial, scan.data, self.measures, quality)

    def _broken(self, scan: ScanInProgress) -> str:
        """Return why the scan did not reach its end, empty where it did."""
        if self._failure:
            return self._failure
        if self._board_restarted:
            return "the finger board restarted"
        if self._detector.broken or scan.failure:
            return self._detector.broken or scan.failure
        if not scan.data.count:
            return "the finger board did not start the scan"
        if not scan.ended:
            return "the finger board did not report the end of the scan"
        return f"the scan took longer than {scan.duration_s:.0f} s" if self.scanning else ""

    def _take_position(self, position: Position, plate: PlatePosition) -> None:
        if self.scan is None or self.scanning:
            self._detect(plate)
        self._guarded_send()

    def _detect(self, plate: PlatePosition) -> None:
        """Start and end the scan by the place of the finger; it does not begin a second time."""
        now_s = self._rig.loop.time()
        if not plate.valid:
            self._follow(self._detector.check_silence(now_s))
            return
        state = self._detector.add(
            now_s, plate.at_s, plate.along_mm, plate.across_mm, plate.height_mm
        )
        if state is SlideState.INSIDE and self.scan is None:
            self._start()
        if self.scan is not None:
            self._positions_s.append(plate.at_s)
        self._follow(state)

    def _follow(self, state: SlideState) -> None:
        """Stop the scan where the finger has left the stretch between the marks."""
        if self.scan is not None and state is not SlideState.INSIDE:
            self._stop()

    def _take_block(self, block: FingerBlock, arrived_s: float) -> None:
        if self.scan is not None:
            rows = self.scan.add_block(block, arrived_s)
            self._pressed.append(self._devices.contact.pressed[rows])

    def _take_message(self, message: Message, arrived_s: float) -> None:
        scan = self.scan
        if scan is None or scan.ended:
            return
        if isinstance(message, WindowReport) and message.scan == scan.number:
            self._output.add_window(message, arrived_s)
        elif isinstance(message, BatchReport) and message.scan == scan.number:
            self._output.add_batch(scan, message, arrived_s)
        scan.add_message(message, arrived_s)

    def _start(self) -> None:
        try:
            self.scan = ScanInProgress(
                self._number,
                self._rig.finger,
                self._devices.estimator,
                self._rig.loop,
                self._output.add_progress,
            )
        except RigFault as fault:
            self._failure = str(fault)

    def _stop(self) -> None:
        try:
            if self.scan is not None:
                self.scan.stop()
        except RigFault as fault:
            self._failure = self._failure or str(fault)

    def _guarded_send(self) -> None:
        try:
            if self.scan is not None:
                self.scan.send_velocities()
        except RigFault as fault:
            self._failure = self._failure or str(fault)
