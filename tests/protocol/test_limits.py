"""Small protocols that would make huge plans are refused before the plan is made."""

from __future__ import annotations

import tracemalloc

import pytest

from rigctl.errors import ProtocolError, WrongUse
from rigctl.finger.plan import parse_finger_protocol
from rigctl.protocol.loader import parse_protocol

TRIALS = "speeds_mm_s = [40]\nforces_g = [250]\n"


def names(n: int) -> str:
    quoted = ", ".join(f"'T{number}'" for number in range(n))
    return f"textures = [{quoted}]\n"


def every(n: int, trials: int) -> str:
    return f"[[steps]]\nat = 'every'\ntrials = {trials}\nkind = 'tare'\n" * n


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (names(20_000) + TRIALS, "line 1: textures: has 20,000 names; 1,000 are the most"),
        (names(200_000) + TRIALS, "larger than 262,144 bytes"),
        (names(1) + TRIALS + "repeats = 1000000\n", "line 4: repeats: 1000000 is outside"),
        (names(2) + TRIALS + "repeats = 60000\n", "make 120,000 trials"),
        (names(1) + TRIALS + "repeats = 100000\n" + every(200, 1), "200 entries; 100 are the most"),
        (names(1) + TRIALS + "repeats = 100000\n" + every(3, 1), "make up to 400,001 steps"),
        (names(1) + TRIALS + f"[plates]\nprompt = '{'{texture}' * 99}'\n", "300 are the most"),
        (names(1) + TRIALS + f"description = '{'x' * 10_001}'\n", "10,000 are the most"),
    ],
)
def test_a_protocol_beyond_the_limits_is_refused(text: str, words: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(ProtocolError) as refused:
            parse_protocol(text, "some.toml")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert words in str(refused.value)
    assert peak < 64e6


def test_a_stage_of_too_many_scans_is_refused() -> None:
    text = names(20) + "[stages]\ntrain = 1000\n"
    with pytest.raises(ProtocolError, match="make 100,800 scans; a protocol has 1 to 20,000"):
        parse_finger_protocol(text, "some.toml")


@pytest.mark.parametrize("seed", [-1, 2**63, 10**400])
def test_a_seed_that_no_session_can_store_is_refused(seed: int) -> None:
    with pytest.raises(WrongUse, match="a seed is a whole number from 0 to"):
        parse_protocol(names(1) + TRIALS, "some.toml").plan(seed)
    with pytest.raises(WrongUse, match="a seed is a whole number from 0 to"):
        parse_finger_protocol(names(2) + "profiles = ['slow']\n", "some.toml").plan([], seed)
