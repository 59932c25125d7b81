"""Physics of the simulated bench."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.bench.bench import Bench
from rigctl.bench.contact import contact_tables, draw_mounting, force_table
from rigctl.bench.load_cell import FULL_SCALE, LAST_COUNTS, NEXT_US, convert
from rigctl.bench.mechanics import (
    DEPTH_MM,
    DRUM_MM,
    FORCE_G,
    LOADCELL_G,
    RING_MS,
    DrumTrajectory,
)
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import LoadcellFault
from rigctl.bench.textures import CATALOGUE, printed_heights
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.encoder.reading import conductance, input_of_each
from rigctl.protocol.fields import CATALOGUE_WORDS
from rigctl.values import DRAWN_WIRING

QUIET = WorldParameters(
    run_out_mm=0.0,
    plate_tilt_mm=0.0,
    plate_give_mm=0.0,
    mounting_spread=0.0,
    contact_spread=0.0,
    contact_load_spread=0.0,
    contact_texture_spread=0.0,
    contact_shift_mm=0.0,
    friction_noise=0.0,
    adc_noise_counts=0.0,
    print_roughness_mm=0.0,
    plate_seating_mm=0.0,
    imbalance_g=0.0,
)


AT_REST = DrumTrajectory(0.0, 0.0, 0.0)


def next_counts(bench: Bench) -> int | None:
    """Return the amplifier's due conversion; None if it offers none."""
    state, constants = bench.loadcell.arrays
    noise = float(bench.loadcell.noise()[0])
    offered = convert(state, constants, bench.plant.log, bench.plant.force_g, noise)
    return int(state[LAST_COUNTS]) if offered else None


def press(bench: Bench, force_g: float) -> None:
    """Lower the drum until the contact force is reached."""
    while bench.plant.force_g < force_g:
        bench.advance(bench.plant.time_ms + 1, 0.2, AT_REST)
    bench.advance(bench.plant.time_ms + 300, 0.0, AT_REST)


def run(bench: Bench, until_ms: int, drive: float, trajectory: DrumTrajectory) -> None:
    """Advance to a time."""
    while bench.plant.time_ms < until_ms:
        bench.advance(until_ms, drive, trajectory)


def turn(bench: Bench, speed_mm_s: float, milliseconds: int) -> NDArray[np.uint16]:
    """Turn at a speed and return the counts at 1 kHz."""
    start_ms, plant = bench.plant.time_ms, bench.plant
    travel_mm = float(plant.log[start_ms % len(plant.log), DRUM_MM]) - bench.parameters.start_mm
    trajectory = DrumTrajectory(1000.0 * start_ms, travel_mm, speed_mm_s)
    run(bench, start_ms + milliseconds, 0.0, trajectory)
    bench.skin.advance()
    starts = 1000.0 * np.arange(start_ms, start_ms + milliseconds - 1, dtype=np.float64)
    return bench.skin.read(start_ms, starts, 50.0)


def by_place(counts: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Counts (n, 18) with the taxels in their places, the top layer first."""
    return counts[:, DRAWN_WIRING].astype(float)


def texture_share(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spread over what the pressure adds to the reading at rest, float64 (18,)."""
    rest = 1023 * QUIET.rest_conductance / (1 + QUIET.rest_conductance)
    share: NDArray[np.float64] = counts.std(axis=0) / (counts.mean(axis=0) - rest)
    return share


def main_frequency_hz(counts: NDArray[np.float64]) -> float:
    """Frequency of the strongest line of a signal sampled at 1 kHz, finely."""
    signal = counts - counts.mean()
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(signal.size), 16 * signal.size))
    line = int(np.argmax(spectrum))
    return 1000.0 * line / (16 * int(signal.shape[0]))


def pressed(parameters: WorldParameters, plate: str, force_g: float) -> NDArray[np.float64]:
    """Rod, depth and force of each millisecond while a plate is pressed, float64 (n, 3)."""
    bench = Bench(parameters, 0)
    bench.set_plate(plate)
    rows = []
    while bench.plant.force_g < force_g:
        bench.advance(bench.plant.time_ms + 1, 0.2, AT_REST)
        row = bench.plant.log[bench.plant.time_ms % len(bench.plant.log)]
        rows.append((bench.plant.rod_mm, row[DEPTH_MM], row[FORCE_G]))
    return np.array(rows)


def test_drag_moves_what_the_load_cell_reads_and_not_the_contact_force() -> None:
    bench = Bench(dataclasses.replace(QUIET, loadcell_drag=0.5), 1)
    press(bench, 800.0)
    log = bench.plant.log
    at_500_g = {0.0: 0.0, 20.0: -0.05, 40.0: -0.1, -40.0: -0.1, 60.0: 0.0, 120.0: 0.3}
    for speed_mm_s, share in at_500_g.items():
        turn(bench, speed_mm_s, 500)
        row = log[bench.plant.time_ms % len(log)]
        read_g = (1 + share * row[FORCE_G] / 500.0) * row[FORCE_G]
        assert row[LOADCELL_G] == pytest.approx(read_g, rel=1e-6)


def test_force_grows_faster_than_depth_and_the_frame_gives_way() -> None:
    rows = pressed(QUIET, "A", 1000.0)
    rod, depth, force = rows[rows[:, 2] > 100.0].T
    assert np.all(np.diff(force) > 0)
    assert np.polyfit(np.log(depth), np.log(force), 1)[0] > QUIET.pressure_power
    stiffness = np.gradient(force, rod)
    assert np.interp(500.0, force, stiffness) == pytest.approx(600.0, rel=0.03)
    frame_g_mm = np.gradient(force, rod - depth)
    assert np.median(frame_g_mm) == pytest.approx(600.0 / QUIET.frame_share, rel=0.03)


def test_the_skin_touches_ridges_first_and_sinks_deeper_into_them() -> None:
    touch_mm, held_mm = {}, {}
    for plate in "ABC":
        rod, _, force = pressed(QUIET, plate, 500.0).T
        touch_mm[plate] = rod[np.argmax(force > 1.0)]
        held_mm[plate] = rod[-1]
    assert max(touch_mm.values()) - min(touch_mm.values()) < 0.15
    assert held_mm["A"] < held_mm["B"] < held_mm["C"] < held_mm["A"] + 2.5


@pytest.mark.parametrize("carrier", [{"skin_length_mm": 33.0}, {"taxel_rise_mm": 0.2}])
def test_skin_beside_the_taxels_carries_a_share_that_depends_on_the_plate(
    carrier: dict[str, float],
) -> None:
    """It leaves the stiffness of a smooth plate as it is."""

    def reading(parameters: WorldParameters, plate: str) -> float:
        bench = Bench(parameters, 0)
        bench.set_plate(plate)
        press(bench, 500.0)
        return float(turn(bench, 80.0, 1000).mean())

    soft = {"frame_share": 0.5, "pressure_power": 2.1}
    bare = dataclasses.replace(QUIET, skin_length_mm=15.0, **soft)
    carried = dataclasses.replace(bare, **carrier)
    rod, _, force = pressed(carried, "A", 600.0).T
    rod, force = rod[force > 100.0], force[force > 100.0]
    assert np.interp(500.0, force, np.gradient(force, rod)) == pytest.approx(600.0, rel=0.03)
    smooth, deep = (reading(carried, plate) / reading(bare, plate) for plate in "AC")
    assert deep < 0.98 * smooth


def test_a_plate_that_gives_in_tilts_with_the_force() -> None:
    yielding = dataclasses.replace(QUIET, plate_give_mm=0.05)

    def pattern(parameters: WorldParameters, force_g: float) -> NDArray[np.float64]:
        bench = Bench(parameters, 1)
        bench.set_plate("A")
        press(bench, force_g)
        return turn(bench, 80.0, 400).mean(axis=0)

    light, heavy = (pattern(yielding, force) / pattern(QUIET, force) for force in (100.0, 1000.0))
    assert np.ptp(heavy) > 1.5 * np.ptp(light) > 0.0


def test_under_a_tilted_sensor_one_column_carries_more_and_the_other_less() -> None:
    patterns = []
    for tilt_mm in (0.0, 0.02):
        bench = Bench(dataclasses.replace(QUIET, sensor_tilt_mm=tilt_mm), 1)
        bench.set_plate("A")
        press(bench, 500.0)
        top = turn(bench, 80.0, 400).mean(axis=0)[np.array(PAPER_ARRAY.drawn_order[:9])]
        patterns.append(top.reshape(3, 3).mean(axis=0))
    deeper, middle, shallower = patterns[1] / patterns[0]
    assert deeper > 1.05 and shallower < 0.95 and abs(middle - 1.0) < 0.05


def test_a_press_of_the_whole_actuator_stays_monotone() -> None:
    for plate in "ACD":
        force = pressed(QUIET, plate, 7500.0)[:, 2]
        assert np.all(np.diff(force) >= 0.0)
        assert force[-1] < 7600.0


@pytest.mark.parametrize("drive", [0.05, -0.05, 0.0])
def test_nothing_moves_inside_the_dead_band(drive: float) -> None:
    bench = Bench(QUIET, 0)
    bench.advance(500, drive, AT_REST)
    assert bench.plant.rod_mm == QUIET.actuator_start_mm


def test_the_actuator_has_its_lag_its_speed_and_its_end_stops() -> None:
    bench = Bench(QUIET, 0)
    bench.advance(30, -1.0, AT_REST)
    early_mm = QUIET.actuator_start_mm - bench.plant.rod_mm
    assert early_mm == pytest.approx(10.0 * 0.030 * math.exp(-1), rel=0.06)
    bench.advance(900, -1.0, AT_REST)
    assert bench.plant.rod_mm == 0.0


def test_backlash_opens_only_under_a_force_above_the_drums_weight() -> None:
    risen_mm = []
    for backlash_mm in (0.0, 0.05):
        bench = Bench(dataclasses.replace(QUIET, drum_weight_g=800.0, backlash_mm=backlash_mm), 0)
        press(bench, 700.0)
        rod_mm = bench.plant.rod_mm
        press(bench, 900.0)
        risen_mm.append(bench.plant.rod_mm - rod_mm)
    assert risen_mm[1] - risen_mm[0] == pytest.approx(0.05, abs=0.015)


def test_run_out_has_the_period_of_a_turn() -> None:
    bench = Bench(dataclasses.replace(QUIET, run_out_mm=0.05), 0)
    press(bench, 500.0)
    start_ms = bench.plant.time_ms
    turn(bench, 200.0, 2000)
    rows = np.arange(start_ms, start_ms + 2000) % len(bench.plant.log)
    force = bench.plant.log[rows, FORCE_G]
    assert np.ptp(force) == pytest.approx(2 * 0.05 * 600, rel=0.1)
    assert force[0] == pytest.approx(force[-1], abs=0.5)


@pytest.mark.parametrize(("plate", "space"), [("B", 1.0), ("I", 2.0), ("L", 1.0), ("P", 0.5)])
@pytest.mark.parametrize("speed_mm_s", [40.0, 120.0])
def test_a_taxel_oscillates_at_speed_over_spacing(
    plate: str, space: float, speed_mm_s: float
) -> None:
    bench = Bench(dataclasses.replace(QUIET, start_mm=20.0), 0)
    bench.set_plate(plate)
    press(bench, 500.0)
    counts = by_place(turn(bench, speed_mm_s, 1900))[200:, 4]
    space_mm = space * QUIET.base_space_mm
    assert main_frequency_hz(counts) == pytest.approx(speed_mm_s / space_mm, rel=0.03)


def test_at_rest_without_contact_the_readings_are_low_and_quiet() -> None:
    bench = Bench(WorldParameters(), 1)
    bench.advance(1000, 0.0, AT_REST)
    bench.skin.advance()
    counts = bench.skin.read(0, 1000.0 * np.arange(900, dtype=np.float64), 50.0)
    assert counts.max() < 40
    assert 0.3 < counts.std(axis=0).mean() < 1.5


def test_under_contact_the_readings_rise_almost_linearly_with_force() -> None:
    means = []
    for force_g in (250.0, 500.0, 1000.0):
        bench = Bench(WorldParameters(start_mm=20.0), 1)
        bench.set_plate("B")
        press(bench, force_g)
        counts = turn(bench, 80.0, 1500)
        assert counts.max() < 600
        means.append(by_place(counts)[:, :9].mean())
    assert 40 < means[0] < means[1] < means[2] < 400
    assert 1.2 * (means[1] - means[0]) < means[2] - means[1] < 2.5 * (means[1] - means[0])


def test_the_top_layer_is_more_sensitive_to_texture_than_the_bottom_layer() -> None:
    bench = Bench(dataclasses.replace(QUIET, start_mm=20.0), 0)
    bench.set_plate("B")
    press(bench, 500.0)
    share = texture_share(by_place(turn(bench, 80.0, 1500)))
    assert np.all(share[:9] > 1.4 * share[9:])


def test_each_taxel_is_read_at_its_own_time() -> None:
    bench = Bench(dataclasses.replace(QUIET, start_mm=20.0, gain_spread=0.0), 0)
    bench.set_plate("L")
    press(bench, 500.0)
    start_ms = bench.plant.time_ms
    turn(bench, 120.0, 500)
    starts = 1000.0 * np.arange(start_ms, start_ms + 400, dtype=np.float64)
    early = bench.skin.read(0, starts, 50.0)[:, 8].astype(float)
    late = bench.skin.read(0, starts + 8 * 50.0, 0.0)[:, 8].astype(float)
    assert np.array_equal(early, late)


def moved(signal: NDArray[np.float64], later: NDArray[np.float64]) -> int:
    """Milliseconds by which the second signal (n,) comes after the first."""
    both = [s - s.mean() for s in (signal, later)]
    lags = np.arange(80)
    match = [np.sum(both[0][:-80] * np.roll(both[1], -lag)[:-80]) for lag in lags]
    return int(lags[np.argmax(match)])


def test_the_sensor_is_wired_as_drawn() -> None:
    """Reading = 6 · line + input: a line is a row along the travel, inputs 0–2 are the top."""
    counts = {}
    for plate in "DF":
        bench = Bench(dataclasses.replace(QUIET, start_mm=20.0), 0)
        bench.set_plate(plate)
        press(bench, 500.0)
        alone = conductance(turn(bench, 100.0, 1500)[300:], input_of_each(range(18), 6, "bench"))
        counts[plate] = alone.astype(float)
    share = texture_share(counts["F"]).reshape(3, 6)
    assert np.all(share[:, :3] > 2 * share[:, 3:])
    for line in (0, 1):
        behind = moved(counts["D"][:, 6 * (line + 1) + 1], counts["D"][:, 6 * line + 1])
        assert behind == pytest.approx(50, abs=2)


def test_the_taxels_of_an_input_load_each_other() -> None:
    bench = Bench(dataclasses.replace(QUIET, start_mm=20.0, sensor_tilt_mm=0.0), 0)
    press(bench, 500.0)
    counts = turn(bench, 0.0, 100)[-1].astype(float)
    conductances = bench.skin.conductances[bench.skin.time_ms % len(bench.skin.conductances)]
    alone = 1023 * conductances / (1 + conductances)
    assert np.all(counts < 0.95 * alone)
    together = conductances.reshape(3, 6) / (1 + conductances.reshape(3, 6).sum(axis=0))
    assert np.abs(counts - 1023 * together.ravel()).max() < 1.5


def test_another_divider_scales_what_the_taxels_conduct() -> None:
    levels = []
    for kohm in (10.0, 1.0):
        bench = Bench(dataclasses.replace(QUIET, start_mm=20.0, divider_kohm=kohm), 0)
        press(bench, 500.0)
        bench.skin.advance()
        levels.append(bench.skin.conductances[bench.skin.time_ms % RING_MS].copy())
    assert np.allclose(levels[0], 10 * levels[1])


def test_a_mounted_plate_keeps_its_alignment_until_it_is_mounted_again() -> None:
    seated = dataclasses.replace(QUIET, plate_tilt_mm=0.05, plate_seating_mm=0.2)

    def patterns(seed: int) -> list[NDArray[np.float64]]:
        bench, means = Bench(seated, seed), []
        for _ in range(2):
            bench.set_plate("A")
            for _ in range(2):
                press(bench, 500.0)
                means.append(turn(bench, 80.0, 400).mean(axis=0))
                bench.advance(bench.plant.time_ms + 900, -1.0, AT_REST)
        return means

    first, again, remounted, _ = patterns(1)
    assert np.abs(again / first - 1).max() < 0.01
    assert np.abs(remounted / first - 1).max() > 0.05
    assert np.array_equal(first, patterns(1)[0])
    assert np.abs(patterns(2)[0] / first - 1).max() > 0.05


def test_dead_and_stuck_readings_do_not_change_with_force() -> None:
    broken = dataclasses.replace(QUIET, dead_taxels=(2,), stuck_taxels=(11,), start_mm=20.0)
    bench = Bench(broken, 0)
    bench.set_plate("B")
    press(bench, 500.0)
    counts = turn(bench, 80.0, 500)
    assert np.all(counts[:, 2] == 0)
    assert np.ptp(counts[:, 11]) == 0
    assert np.ptp(counts[:, 7]) > 5


def test_sessions_differ_a_little_and_contacts_less() -> None:
    level = WorldParameters(plate_tilt_mm=0.0, plate_give_mm=0.0)
    means = []
    for seed in (1, 2):
        bench = Bench(level, seed)
        press(bench, 500.0)
        means.append(turn(bench, 80.0, 500).mean(axis=0))
    change = np.abs(means[0] / means[1] - 1)
    assert 0.005 < change.mean() < 0.15


def test_the_load_cell_weighs_the_contact_at_its_own_80_hz() -> None:
    bench = Bench(dataclasses.replace(QUIET, loadcell_drift_g=0.0), 4)
    readings, times = [], []
    while bench.plant.time_ms < 2000:
        due_us = int(bench.loadcell.arrays[0][NEXT_US])
        bench.advance(due_us // 1000, 0.0, AT_REST)
        readings.append(next_counts(bench))
        times.append(due_us)
    grams = (np.array(readings, float) - 80_000) * 2400e-6
    assert grams.std() == pytest.approx(0.3, rel=0.25)
    assert np.diff(times).mean() == pytest.approx(12_500 / 1.008, abs=1)
    assert times[0] == pytest.approx(4 * 12_500 / 1.008, abs=1)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [(LoadcellFault.SILENT, None), (LoadcellFault.SATURATED, FULL_SCALE)],
)
def test_the_load_cells_faults(fault: LoadcellFault, expected: int | None) -> None:
    bench = Bench(QUIET, 0)
    bench.advance(60, 0.0, AT_REST)
    bench.disturbances.loadcell = fault
    assert next_counts(bench) == expected


def test_the_catalogue_has_sixteen_plates_with_their_heights_and_spacings() -> None:
    p = WorldParameters()
    along = np.arange(0.0, 60.0, 0.01)
    assert "".join(CATALOGUE) == "ABCDEFGHIJKLMNOP"
    for words in CATALOGUE_WORDS.split(", "):
        letters, _, group = words.partition(" ")
        first, _, last = letters.partition("–")
        ends = CATALOGUE[first], CATALOGUE[last or first]
        assert {plate.group for plate in ends} == {group}
    for letter, plate in CATALOGUE.items():
        heights = printed_heights(plate, along, p)
        assert heights.max() == pytest.approx(p.base_height_mm * plate.height, abs=1e-3)
        if letter != "A":
            shifted = printed_heights(plate, along + p.base_space_mm * plate.space, p)
            assert np.mean(np.abs(heights - shifted)) < 0.01


def test_the_clamp_is_smooth_and_carries_the_same_force_as_the_plate() -> None:
    tables = contact_tables("C", QUIET)
    gap = tables.conductance[50, round(394 / 0.05) : round(396 / 0.05), 0]
    assert np.ptp(gap) < 0.02 * tables.conductance[50, :, 0].max()
    force = force_table(tables, QUIET, draw_mounting(QUIET, 1, 0)).force_g
    row = int(np.argmin(np.abs(force.mean(axis=1) - 500.0)))
    assert np.all(np.abs(force[row] / force[row].mean() - 1.0) < 0.2)


def test_ground_truth_is_the_same_in_one_piece_or_in_parts() -> None:
    whole, pieces = Bench(WorldParameters(), 1), Bench(WorldParameters(), 1)
    trajectory = DrumTrajectory(0.0, 0.0, 80.0)
    taken = []
    for until in range(100, 3001, 100):
        run(whole, until, 0.3, trajectory)
        run(pieces, until, 0.3, trajectory)
        taken.append(pieces.truth.take())
    assert [t.first_ms for t in taken] == list(range(0, 3000, 100))
    together = np.concatenate([t.force_g for t in taken])
    assert np.array_equal(whole.truth.arrays().force_g, together)
    assert whole.truth.arrays().speed_mm_s.mean() == pytest.approx(80.0)
