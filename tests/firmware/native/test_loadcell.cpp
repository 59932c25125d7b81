// The load cell: force, ring, tare, and each way in which an amplifier fails.
#include "variant.h"
#include "check.h"
#include "drum_states.h"
#include "loadcell.h"

namespace {

struct Cell {
    Loadcell cell;
    uint32_t at_us = 0;

    void take(int32_t raw, bool in_step = true) {
        at_us += board::LOADCELL_PERIOD_US;
        cell.take({raw, at_us, in_step});
        cell.tick(at_us);
    }
    void settle() {
        for (int i = 0; i < Loadcell::SETTLING + 1; ++i) take(1000 + i);
    }
    bool has(Fault fault) const { return cell.faults() >> static_cast<int>(fault) & 1; }
};

}  // namespace

TEST(the_first_conversions_are_thrown_away) {
    Cell c;
    for (int i = 0; i < Loadcell::SETTLING; ++i) {
        c.take(5);
        CHECK(!c.cell.alive());
        CHECK_EQUAL(c.cell.sequence(), 0);
    }
    c.take(6);
    CHECK(c.cell.alive());
    CHECK_EQUAL(c.cell.sequence(), 1);
}

TEST(force_is_counts_from_tare_times_scale) {
    Cell c;
    c.settle();
    c.cell.set_scale(80000, 2400);
    for (int i = 0; i < 2; ++i) c.take(80000 + 208333);  // one alone may be a spike
    CHECK_NEAR(c.cell.force_g(), 500, 0.01);
    c.cell.set_scale(80000, -2400);
    CHECK_NEAR(c.cell.force_g(), -500, 0.01);
}

TEST(sample_n_stands_at_place_n_of_the_ring) {
    Cell c;
    c.settle();
    for (int32_t i = 0; i < 200; ++i) {
        c.take(7000 + i);
        const uint16_t n = c.cell.sequence();
        CHECK_EQUAL(c.cell.ring_raw(n % RING_DEPTH), 7000 + i);
        CHECK_EQUAL(c.cell.ring_time_us(n % RING_DEPTH), c.at_us);
        if (i) CHECK_EQUAL(c.cell.ring_raw((n - 1) % RING_DEPTH), 7000 + i - 1);
    }
}

TEST(silence_is_a_fault_after_2_4_periods) {
    Cell c;
    c.settle();
    c.cell.tick(c.at_us + 30000);
    CHECK(!c.has(Fault::LoadcellSilent));
    c.cell.tick(c.at_us + 30001);
    CHECK(c.has(Fault::LoadcellSilent));
    c.take(4242);
    CHECK(!c.has(Fault::LoadcellSilent));
}

TEST(silence_is_seen_across_the_wrap_of_the_clock) {
    Cell c;
    c.at_us = 0xffffffffu - 60000;
    c.settle();
    c.cell.tick(c.at_us + 20000);
    CHECK(!c.has(Fault::LoadcellSilent));
    c.cell.tick(c.at_us + 40000);
    CHECK(c.has(Fault::LoadcellSilent));
}

TEST(both_ends_of_the_range_are_saturation) {
    for (int32_t raw : {0x7fffff, -0x800000}) {
        Cell c;
        c.settle();
        c.take(raw);
        CHECK(c.has(Fault::LoadcellSaturated));
        c.take(1);
        CHECK(!c.has(Fault::LoadcellSaturated));
    }
}

TEST(one_value_again_and_again_is_frozen) {
    Cell c;
    c.settle();
    c.take(99);
    for (int i = 1; i < Loadcell::FROZEN_RUN; ++i) {
        c.take(99);
        CHECK(!c.has(Fault::LoadcellFrozen));
    }
    c.take(99);
    CHECK(c.has(Fault::LoadcellFrozen));
    c.take(100);
    CHECK(!c.has(Fault::LoadcellFrozen));
}

TEST(a_wrong_answer_to_the_gain_pulse_is_desync) {
    Cell c;
    c.settle();
    c.take(7, false);
    CHECK(c.has(Fault::LoadcellDesync));
    c.take(8);
    CHECK(!c.has(Fault::LoadcellDesync));
}

TEST(tare_is_the_mean_of_its_samples) {
    Cell c;
    c.settle();
    c.cell.begin_tare();
    for (int i = 0; i < Loadcell::TARE_PAUSE; ++i) c.take(i);
    for (int i = 0; i < Loadcell::TARE_SAMPLES; ++i) {
        CHECK(c.cell.taring());
        c.take(-8000000 + (i % 2 ? 10 : -10));
    }
    CHECK(!c.cell.taring());
    CHECK_EQUAL(c.cell.tare_mean(), -8000000);
    CHECK_EQUAL(c.cell.tare_spread(), 20);
}

TEST(a_conversion_left_out_is_counted) {
    Cell c;
    c.settle();
    c.at_us += board::LOADCELL_PERIOD_US;
    c.take(1);
    CHECK_EQUAL(c.cell.dropped(), 1);
}

namespace {

// As many samples as the first test of the amplifier takes, and one measurement of the rate.
constexpr int ENOUGH = Loadcell::SETTLING + Loadcell::RATE_INTERVALS + 1;

uint32_t faults_of_readings(int32_t (*reading)(int), int samples = ENOUGH + RING_DEPTH) {
    Cell c;
    for (int i = 0; i < samples; ++i) {
        c.take(reading(i));
        if (c.cell.sequence()) c.cell.test(true);
    }
    return c.cell.faults();
}

constexpr uint32_t NOISE = 1u << static_cast<int>(Fault::LoadcellNoise);
constexpr uint32_t RATE = 1u << static_cast<int>(Fault::LoadcellRate);

// Uniform in ± `most`, from a number.
int32_t spread(int i, int32_t most) {
    uint32_t mixed = static_cast<uint32_t>(i + 1) * 2654435761u;
    mixed = (mixed ^ mixed >> 15) * 2246822519u;
    mixed = (mixed ^ mixed >> 13) * 3266489917u >> 8;
    return static_cast<int32_t>(mixed % static_cast<uint32_t>(2 * most + 1)) - most;
}

}  // namespace

TEST(readings_as_noisy_as_an_amplifier_and_a_cell_pass_its_test) {
    CHECK_EQUAL(faults_of_readings([](int i) { return 80000 + spread(i, 36); }), 0u);   // 21 rms
    CHECK_EQUAL(faults_of_readings([](int i) { return 80000 + spread(i, 1730); }), 0u); // 1000 rms
}

TEST(readings_that_no_cell_gives_fail_the_test) {
    CHECK_EQUAL(faults_of_readings([](int i) { return 80000 + spread(i, 1); }), NOISE);
    CHECK_EQUAL(faults_of_readings([](int i) { return 80000 + i / 5 * 100; }), NOISE);
    CHECK_EQUAL(faults_of_readings([](int i) { return 80000 + spread(i, 7000); }), NOISE);
}

TEST(a_hand_that_loads_the_cell_does_not_fail_the_test) {
    CHECK_EQUAL(faults_of_readings([](int i) {
                    const int32_t load = i < 40 ? 0 : i < 50 ? (i - 40) * 20000 : 200000;
                    return 80000 + load + spread(i, 200);
                }), 0u);
}

TEST(the_test_takes_eight_samples_at_rest_in_a_row) {
    Cell c;
    for (int i = 0; i < Loadcell::SETTLING; ++i) c.take(80000 + 50 * i);
    for (int i = 0; i < AmplifierTest::FIRST_SAMPLES; ++i) {
        CHECK(!c.cell.test().known());
        c.take(80000 + 50 * i);
        c.cell.test(true);
        if (i == 3) break;
    }
    c.cell.test(false);
    for (int i = 0; i < AmplifierTest::FIRST_SAMPLES; ++i) {
        CHECK(!c.cell.test().known());
        c.take(80000 + 50 * i);
        c.cell.test(true);
    }
    CHECK(c.cell.test().known());
    CHECK_EQUAL(c.cell.test().unique(), 8);
    CHECK_NEAR(c.cell.test().noise_tenths(), 1146, 1);  // of 0, 50 ... 350
}

TEST(the_rate_is_measured_and_another_one_is_a_fault_but_not_silence) {
    for (const uint32_t period_us : {12500u, 11300u, 14000u, 20000u, 90000u, 100000u, 6000u}) {
        Cell c;
        for (int i = 0; i < ENOUGH; ++i) {
            c.at_us += period_us - board::LOADCELL_PERIOD_US;
            c.take(80000 + spread(i, 60));
        }
        CHECK_NEAR(c.cell.rate(), 1e8 / period_us, 1);
        const bool wrong = period_us > 15000 || period_us < 10000;
        CHECK_EQUAL(c.cell.faults(), wrong ? RATE : 0u);
        for (uint32_t us = 0; us < period_us; us += 1000) c.cell.tick(c.at_us + us);
        CHECK_EQUAL(c.cell.faults(), wrong ? RATE : 0u);
        c.cell.configure(sampling::SLOW);
        CHECK_EQUAL(c.cell.faults(), period_us < 80000 ? RATE : 0u);
    }
}

TEST(missing_conversions_are_not_a_slow_rate) {
    Cell c;
    for (int i = 0; i < 100; ++i) {
        if (i % 5 == 0) c.at_us += 3 * board::LOADCELL_PERIOD_US;
        c.take(80000 + spread(i, 60));
        CHECK(!c.has(Fault::LoadcellRate));
    }
}

TEST(a_spike_is_counted_and_the_loop_never_sees_it) {
    for (const int32_t spike : {416667, -416667}) {  // 1000 g
        Cell c;
        c.settle();
        c.cell.set_scale(1000, 2400);
        for (int i = 0; i < 20; ++i) {
            c.take(1000 + spread(i, 60) + (i == 10 ? spike : 0));
            CHECK_NEAR(c.cell.force_g(), 0, 1);
        }
        CHECK_EQUAL(c.cell.spikes(), 1);
        CHECK_NEAR(c.cell.measured_g(), 0, 1);
    }
}

TEST(a_force_that_really_jumps_is_no_spike_and_reaches_the_loop_one_sample_late) {
    Cell c;
    c.settle();
    c.cell.set_scale(1000, 2400);
    c.take(417667);
    CHECK_NEAR(c.cell.measured_g(), 1000, 0.1);
    CHECK_NEAR(c.cell.force_g(), 0, 0.1);
    c.take(417668);
    CHECK_NEAR(c.cell.force_g(), 1000, 0.1);
    CHECK_EQUAL(c.cell.spikes(), 0);
}

TEST(at_ten_samples_a_second_nothing_is_held_back) {
    Cell c;
    c.settle();
    c.cell.configure(sampling::SLOW);
    c.cell.set_scale(1000, 2400);
    c.take(417667);
    CHECK_NEAR(c.cell.force_g(), 1000, 0.1);
}
