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
