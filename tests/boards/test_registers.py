"""The register table in engineering units: values are restored, invalid ones refused."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.boards import drum_registers
from rigctl.boards.drum_registers import BY_NAME, END, REGISTERS, SETTINGS, SETTINGS_BLOCK
from rigctl.errors import WrongUse

WRITABLE = [entry.name for entry in SETTINGS]


def test_the_table_has_no_overlap_and_ends_where_it_says() -> None:
    ordered = sorted(REGISTERS, key=lambda entry: entry.address)
    assert all(a.end <= b.address for a, b in pairwise(ordered))
    assert ordered[-1].end == END
    assert all(e.accepts(e.default) for e in SETTINGS)


@given(st.sampled_from(WRITABLE), st.data())
def test_every_value_in_bounds_comes_back(name: str, data: st.DataObject) -> None:
    entry = BY_NAME[name]
    raw = data.draw(st.integers(entry.low, entry.high).filter(entry.accepts))
    words = drum_registers.pack_value(entry, drum_registers.to_raw(name, raw * entry.scale))
    layout = drum_registers.BlockLayout(entry.address, entry.words)
    assert layout.unpack(words)[name] == (raw,)
    assert layout.values(words)[name] == pytest.approx(raw * entry.scale)


@given(st.sampled_from(WRITABLE), st.data())
def test_every_value_out_of_bounds_is_refused_by_name(name: str, data: st.DataObject) -> None:
    entry = BY_NAME[name]
    raw = data.draw(st.integers().filter(lambda n: not entry.accepts(n)))
    with pytest.raises(WrongUse, match=name):
        drum_registers.to_raw(name, float(raw) * entry.scale)


def test_a_refusal_names_register_value_bounds_and_unit() -> None:
    with pytest.raises(WrongUse) as refusal:
        drum_registers.to_raw("speed_set", 300)
    assert str(refusal.value) == "speed_set cannot be 300 mm/s: the drum takes 5 to 200 mm/s"


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("speed", 80.0, "measured by the drum"),
        ("sped_set", 80.0, "no register 'sped_set'"),
        ("force_set", float("nan"), "force_set cannot be nan g"),
        ("force_set", float("inf"), "force_set cannot be inf g"),
    ],
)
def test_unsettable_values_are_refused(name: str, value: float, sentence: str) -> None:
    with pytest.raises(WrongUse, match=sentence):
        drum_registers.to_raw(name, value)


@given(st.sets(st.sampled_from(WRITABLE), min_size=1))
def test_planned_writes_hold_every_name_once_and_stay_short(names: set[str]) -> None:
    values = {name: BY_NAME[name].default * BY_NAME[name].scale for name in names}
    writes = drum_registers.plan_writes(values)
    assert sorted(n for w in writes for n in w.names) == sorted(names)
    for write in writes:
        assert 9 + 2 * len(write.words) < 64
        layout = drum_registers.BlockLayout(write.address, len(write.words))
        assert layout.values(write.words) == pytest.approx({n: values[n] for n in write.names})


def test_one_bad_value_plans_nothing() -> None:
    with pytest.raises(WrongUse, match="force_set"):
        drum_registers.plan_writes({"speed_set": 80, "force_set": 1e6})


@given(st.sets(st.sampled_from([e.name for e in REGISTERS if e.count == 1]), min_size=1))
def test_reads_cover_every_name_in_short_blocks(names: set[str]) -> None:
    layouts = drum_registers.plan_reads(names)
    assert sorted(e.name for layout in layouts for e in layout.entries) == sorted(names)
    assert all(layout.count <= 40 for layout in layouts)


def test_a_block_is_read_by_name_and_a_short_one_is_refused() -> None:
    layout = drum_registers.BlockLayout(*SETTINGS_BLOCK)
    words = [word for entry in SETTINGS for word in drum_registers.pack_value(entry, entry.default)]
    assert layout.unpack(words) == {entry.name: (entry.default,) for entry in SETTINGS}
    with pytest.raises(ValueError, match="expected 51 registers, received 3"):
        layout.unpack((1, 2, 3))
