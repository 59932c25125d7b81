#include "finger.h"

#include <string.h>

namespace {

const uint32_t STATUS_EVERY = 100;  // samples
// More is no interruption of a scan any more: the host refuses the scan long before.
const uint16_t MAX_LOST = 1000;
const double NO_NUMBERS[FEATURES] = {};
const ClassifierModel NO_MODEL = {0, 0, NO_NUMBERS, NO_NUMBERS, NO_NUMBERS, NO_NUMBERS};
const uint32_t SLOWEST_REFERENCE = 1000, FASTEST_REFERENCE = 10000000;

}  // namespace

Finger::Finger(HostLine &line, const ClassifierModel *model)
    : line_(line), classifies_(model != nullptr), classifier_(model ? *model : NO_MODEL), scan_(*this)
{
}

void Finger::begin() { send(write_identity()); }

void Finger::send(const WireFrame &frame)
{
    if (!line_.send(frame.bytes, frame.size)) dropped_frames_++;
}

void Finger::take_sample(Sample &sample, uint16_t lost)
{
    const bool in_scan = scan_.sampling();
    samples_ += lost;
    lost_samples_ += lost;
    for (uint16_t i = 0; i < lost && i < MAX_LOST; i++) scan_.add_lost();
    neurons_.advance(sample);
    send_data(sample, in_scan, lost != 0);
    scan_.add(sample);
    if (++samples_ % STATUS_EVERY == 0) send_status();
}

void Finger::send_data(const Sample &sample, bool in_scan, bool lost_before)
{
    const uint8_t flags = uint8_t((in_scan ? FLAG_IN_SCAN : 0) | (first_sample_ ? FLAG_FIRST : 0) |
                                  (lost_before ? FLAG_LOST_BEFORE : 0));
    first_sample_ = false;
    send(write_data(sample, samples_, flags));
}

void Finger::send_status()
{
    send(write_status({samples_, lost_samples_, scan_.late_velocities(), scan_.early_velocities(),
                       receiver_.damaged() + unknown_requests_, damaged_frames_,
                       dropped_frames_}));
}

void Finger::receive(uint8_t byte)
{
    const uint8_t size = receiver_.feed(byte);
    if (!size) return;
    Request request = {};
    if (read_request(receiver_.body(), size, request)) handle(request);
    else unknown_requests_++;
}

void Finger::handle(const Request &request)
{
    Result result = Result::Ok;
    switch (request.type) {
    case RequestType::Identify: return begin();
    case RequestType::ReadSettings:
        return send(write_settings({neurons_.ranges(), reference_um_per_s_, neurons_.gain}));
    case RequestType::SetRanges: result = set_ranges(request.ranges); break;
    case RequestType::SetReference: result = set_reference(request.reference_um_per_s); break;
    case RequestType::Start: start(request.scan); break;
    case RequestType::Velocity: result = set_velocity(request); break;
    case RequestType::Stop: scan_.stop(); break;
    case RequestType::SetMean: result = set_mean(request); break;
    case RequestType::SetGain: result = set_gain(request); break;
    }
    send(write_answer(request.type, result, request.scan));
}

Result Finger::set_ranges(const Ranges &ranges)
{
    if (scan_.sampling()) return Result::Scanning;
    for (uint8_t i = 0; i < TAXELS; i++)
        if (ranges.low[i] > ranges.high[i]) return Result::WrongValue;
    neurons_.set_ranges(ranges);
    return Result::Ok;
}

Result Finger::set_reference(uint32_t reference_um_per_s)
{
    if (scan_.sampling()) return Result::Scanning;
    if (reference_um_per_s < SLOWEST_REFERENCE || reference_um_per_s > FASTEST_REFERENCE)
        return Result::WrongValue;
    reference_um_per_s_ = reference_um_per_s;
    return Result::Ok;
}

Result Finger::set_velocity(const Request &request)
{
    if (request.velocity_um_per_s > fastest_um_per_s(reference_um_per_s_)) return Result::WrongValue;
    const bool taken =
        scan_.set_velocity(request.scan, request.batch, request.velocity_um_per_s);
    return taken ? Result::Ok : Result::NotWaiting;
}

Result Finger::set_mean(const Request &request)
{
    if (!classifies_) return Result::NoModel;
    if (scan_.sampling()) return Result::Scanning;
    if (request.window >= WINDOWS) return Result::WrongValue;
    classifier_.set_mean(request.window, request.mean);
    return Result::Ok;
}

Result Finger::set_gain(const Request &request)
{
    if (scan_.sampling()) return Result::Scanning;
    if (request.part >= GAIN_PARTS || request.shift > MAX_GAIN_SHIFT) return Result::WrongValue;
    for (uint16_t gain : request.gains)
        if (gain > MAX_GAIN) return Result::WrongValue;
    neurons_.gain.shift = request.shift;
    memcpy(neurons_.gain.gains + PART_GAINS * request.part, request.gains, sizeof request.gains);
    return Result::Ok;
}

// A scan starts at rest, like every trial of the encoder.
void Finger::start(uint32_t scan)
{
    neurons_.reset();
    classifier_.start();
    first_sample_ = true;
    scan_.start(scan, reference_um_per_s_);
}

void Finger::window_closed(const WindowReport &window)
{
    classifier_.add(window);
    send(write_window(window));
}

void Finger::batch_scaled(const BatchReport &batch) { send(write_batch(batch)); }

void Finger::scan_ended(uint32_t scan)
{
    if (classifies_) send(write_prediction(classifier_.predict(scan)));
    send(write_scan_ended(scan));
}
