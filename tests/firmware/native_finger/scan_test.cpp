// Scaled time, batches and windows of the finger board.
#include "../native/check.h"
#include "scan.h"

#include <vector>

namespace {

struct Recorder final : ScanOutput {
    std::vector<WindowReport> windows;
    std::vector<BatchReport> batches;
    uint32_t ended = 0;
    void window_closed(const WindowReport &window) override { windows.push_back(window); }
    void batch_scaled(const BatchReport &batch) override { batches.push_back(batch); }
    void scan_ended(uint32_t) override { ended++; }
};

Sample one_spike_each()
{
    Sample sample = {};
    for (uint8_t &spikes : sample.spikes) spikes = 1;
    return sample;
}

void add(Scan &scan, int samples)
{
    const Sample sample = one_spike_each();
    for (int i = 0; i < samples; i++) scan.add(sample);
}

}  // namespace

TEST(scaled_time_is_the_integral_of_any_piecewise_constant_velocity)
{
    ScaledTime time;
    time.start(100000);
    uint64_t expected_nm = 0;
    uint32_t velocity = 1;
    for (int batch = 0; batch < 1000; batch++) {
        velocity = velocity * 1103515245u + 12345u;
        const uint32_t um_per_s = velocity % 10000000u;
        for (int ms = 0; ms < 100; ms++) {
            CHECK(time.advance(um_per_s) == expected_nm / 10000000u);
            expected_nm += um_per_s;
        }
    }
    CHECK(time.distance_nm() == expected_nm);
}

TEST(a_window_is_ten_millimetres_at_the_default_reference)
{
    Recorder out;
    Scan scan(out);
    scan.start(7, DEFAULT_REFERENCE_UM_PER_S);
    for (uint32_t batch = 0; batch < 4; batch++) {
        add(scan, 100);
        CHECK(scan.set_velocity(7, batch, 50000));  // 5 mm a batch: two batches a window
    }
    scan.stop();
    CHECK(out.ended == 1);
    CHECK(out.windows.size() == 2);
    for (const WindowReport &window : out.windows) {
        CHECK(window.scan == 7);
        CHECK(window.real_ms == 200);
        for (uint16_t spikes : window.spikes) CHECK(spikes == 200);
    }
}

TEST(a_late_velocity_is_counted_and_the_batch_says_what_it_used)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 200);  // two batches without a velocity: the first cannot wait any longer
    CHECK(out.batches.size() == 1);
    CHECK(out.batches[0].source == VelocitySource::Missing);
    CHECK(out.batches[0].velocity_um_per_s == 0);
    CHECK(!scan.set_velocity(1, 0, 80000));
    CHECK(scan.late_velocities() == 1);
    CHECK(scan.set_velocity(1, 1, 80000));
    add(scan, 200);
    CHECK(out.batches[2].source == VelocitySource::Held);
    CHECK(out.batches[2].velocity_um_per_s == 80000);
}

TEST(a_velocity_for_a_batch_that_is_still_open_is_early)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 99);
    CHECK(!scan.set_velocity(1, 0, 80000));
    CHECK(scan.early_velocities() == 1);
    CHECK(!scan.set_velocity(2, 0, 80000));  // another scan's
    CHECK(scan.late_velocities() == 1);
}

TEST(the_last_batch_is_short_and_the_scan_ends_with_its_velocity)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 137);
    CHECK(scan.set_velocity(1, 0, 100000));
    scan.stop();
    CHECK(out.ended == 0);
    add(scan, 50);  // behind the scan
    CHECK(scan.set_velocity(1, 1, 100000));
    CHECK(out.ended == 1);
    CHECK(out.batches[1].samples == 37);
    CHECK(out.windows.back().real_ms == 37);
}

TEST(a_second_stop_ends_a_scan_whose_last_velocity_was_lost)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 100);
    scan.stop();
    CHECK(out.ended == 0);
    scan.stop();
    CHECK(out.ended == 1);
    CHECK(out.batches[0].source == VelocitySource::Missing);
    scan.stop();
    CHECK(out.ended == 1);
}

TEST(a_stop_leaves_the_batch_before_the_last_its_time)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 103);
    scan.stop();
    CHECK(out.batches.empty());
    CHECK(scan.set_velocity(1, 0, 100000));
    CHECK(scan.set_velocity(1, 1, 50000));
    CHECK(out.ended == 1);
    CHECK(out.batches[0].source == VelocitySource::Received);
    CHECK(out.batches[1].samples == 3);
    CHECK(out.batches[1].velocity_um_per_s == 50000);
}

TEST(a_velocity_that_skips_a_waiting_batch_leaves_it_the_one_before)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 100);
    CHECK(scan.set_velocity(1, 0, 80000));
    add(scan, 105);
    scan.stop();
    CHECK(scan.set_velocity(1, 2, 50000));
    CHECK(out.ended == 1);
    CHECK(out.batches[1].source == VelocitySource::Held);
    CHECK(out.batches[1].velocity_um_per_s == 80000);
    CHECK(!scan.set_velocity(1, 1, 70000));
    CHECK(scan.late_velocities() == 1);
}

TEST(lost_samples_take_their_time)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 90);
    for (int i = 0; i < 10; i++) scan.add_lost();
    CHECK(scan.set_velocity(1, 0, 100000));
    CHECK(out.batches[0].lost_samples == 10);
    add(scan, 1);
    scan.stop();
    scan.stop();
    CHECK(out.windows[0].real_ms == 100);
    CHECK(out.windows[0].spikes[0] == 90);
}

TEST(an_endless_scan_stops_before_a_counter_overflows)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 70000);
    CHECK(!scan.sampling());
    scan.stop();
    CHECK(out.ended == 1);
    CHECK(out.windows.size() == 1);
    CHECK(out.windows[0].real_ms == MAX_SCAN_SAMPLES);
}

TEST(a_standing_finger_stays_in_its_window)
{
    Recorder out;
    Scan scan(out);
    scan.start(1, DEFAULT_REFERENCE_UM_PER_S);
    add(scan, 100);
    CHECK(scan.set_velocity(1, 0, 0));
    add(scan, 100);
    CHECK(scan.set_velocity(1, 1, 100000));
    scan.stop();
    CHECK(out.windows.size() == 1);
    CHECK(out.windows[0].real_ms == 200);
}
