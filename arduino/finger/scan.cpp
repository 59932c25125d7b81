#include "scan.h"

namespace {

const uint8_t NO_SPIKES[TAXELS] = {};

}  // namespace

void Scan::start(uint32_t scan, uint32_t reference_um_per_s)
{
    state_ = State::Sampling;
    scan_ = scan;
    time_.start(reference_um_per_s);
    window_ = {};
    window_.scan = scan;
    samples_left_ = MAX_SCAN_SAMPLES;
    open_batch_ = scaled_batches_ = 0;
    batches_[0].samples = batches_[0].lost_samples = 0;
    has_velocity_ = false;
    velocity_um_per_s_ = 0;
}

void Scan::stop()
{
    if (state_ == State::Sampling) {
        state_ = State::Stopped;
        if (batches_[open_batch_ & 1].samples) open_batch_++;
    } else {
        while (waiting()) scale_without_velocity();
    }
    end_if_complete();
}

void Scan::add(const Sample &sample) { add_spikes(sample.spikes, false); }
void Scan::add_lost() { add_spikes(NO_SPIKES, true); }

void Scan::add_spikes(const uint8_t *spikes, bool lost)
{
    if (state_ != State::Sampling) return;
    Batch &batch = batches_[open_batch_ & 1];
    for (uint8_t i = 0; i < TAXELS; i++) batch.spikes[batch.samples][i] = spikes[i];
    batch.samples++;
    batch.lost_samples = uint8_t(batch.lost_samples + lost);
    if (batch.samples == BATCH_SAMPLES) close_batch();
    if (--samples_left_ == 0) stop();
}

// Its velocity may arrive until the next batch is complete: there is room for two. The short last
// batch does not end that time: a stop needs no room.
void Scan::close_batch()
{
    if (waiting()) scale_without_velocity();
    open_batch_++;
    Batch &next = batches_[open_batch_ & 1];
    next.samples = next.lost_samples = 0;
}

bool Scan::set_velocity(uint32_t scan, uint32_t batch, uint32_t velocity_um_per_s)
{
    if (scan != scan_ || state_ == State::Idle || batch < scaled_batches_) {
        late_velocities_++;
        return false;
    }
    if (batch >= open_batch_) {
        early_velocities_++;
        return false;
    }
    if (batch > scaled_batches_) scale_without_velocity();
    has_velocity_ = true;
    velocity_um_per_s_ = velocity_um_per_s;
    scale_waiting(velocity_um_per_s, VelocitySource::Received);
    end_if_complete();
    return true;
}

void Scan::scale_without_velocity()
{
    const VelocitySource source = has_velocity_ ? VelocitySource::Held : VelocitySource::Missing;
    scale_waiting(velocity_um_per_s_, source);
}

void Scan::scale_waiting(uint32_t velocity_um_per_s, VelocitySource source)
{
    const uint32_t number = scaled_batches_++;
    const Batch &batch = batches_[number & 1];
    const BatchReport report = {scan_, number, velocity_um_per_s, source, batch.samples,
                                batch.lost_samples, time_.distance_nm()};
    for (uint8_t row = 0; row < batch.samples; row++)
        add_to_window(time_.advance(velocity_um_per_s), batch.spikes[row]);
    output_.batch_scaled(report);
}

void Scan::add_to_window(uint32_t window, const uint8_t *spikes)
{
    if (window != window_.window) {
        close_window();
        window_.window = uint16_t(window);
    }
    window_.real_ms++;
    for (uint8_t i = 0; i < TAXELS; i++) window_.spikes[i] = uint16_t(window_.spikes[i] + spikes[i]);
}

void Scan::close_window()
{
    output_.window_closed(window_);
    window_ = {};
    window_.scan = scan_;
}

void Scan::end_if_complete()
{
    if (state_ != State::Stopped || waiting()) return;
    state_ = State::Idle;
    if (window_.real_ms) close_window();
    output_.scan_ended(scan_);
}
