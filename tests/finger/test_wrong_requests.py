"""Thousands of wrong requests to the finger's engine: it answers and its run goes on."""

from __future__ import annotations

from rigctl.finger.bench.virtual import FingerFaults
from rigctl.finger.commands import FingerCommands
from tests.engine.rpc.wrong_requests import Attacker, declared, wrong_requests
from tests.finger.harness import ONE_SCAN, FingerHarness, until_ended


def test_a_finger_run_goes_on_under_wrong_requests(harness: FingerHarness) -> None:
    async def scenario(harness: FingerHarness) -> None:
        await harness.until_scanning()
        client = await Attacker.connect(harness.address)
        await client.attack(wrong_requests(*declared(FingerCommands, FingerFaults)))
        await until_ended(harness)
        await client.close()
        client.require_refusals()

    harness.run(scenario, harness.request(protocol=ONE_SCAN))
    run = harness.engine.run
    assert run is not None and run.text == "every scan is committed"
    assert harness.texts("fault") == []
