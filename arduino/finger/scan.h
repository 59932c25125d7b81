// One scan over a plate: batches of 100 samples wait for their velocity, then fill windows.
#ifndef FINGER_SCAN_H
#define FINGER_SCAN_H

#include <stdint.h>

#include "neurons.h"
#include "scaled_time.h"

const uint8_t BATCH_SAMPLES = 100;
const uint16_t MAX_SCAN_SAMPLES = 60000;  // a longer scan stops by itself; counters cannot overflow

// Where the velocity of a batch came from.
enum class VelocitySource : uint8_t {
    Received = 0,
    Held = 1,     // it did not arrive in time: the velocity of the batch before
    Missing = 2,  // as Held, but no velocity has arrived in this scan: 0
};

// A batch that has been scaled.
struct BatchReport {
    uint32_t scan, batch;
    uint32_t velocity_um_per_s;
    VelocitySource source;
    uint8_t samples, lost_samples;
    uint64_t start_nm;  // distance at the batch's first sample
};

// Spikes in one window of scaled time, and the real time that the window took.
struct WindowReport {
    uint32_t scan;
    uint16_t window, real_ms;
    uint16_t spikes[TAXELS];
};

// Receives what a scan produces, in this order: the windows that a batch completed, the batch.
class ScanOutput {
public:
    virtual void window_closed(const WindowReport &window) = 0;
    virtual void batch_scaled(const BatchReport &batch) = 0;
    virtual void scan_ended(uint32_t scan) = 0;

protected:
    ~ScanOutput() = default;
};

class Scan {
public:
    explicit Scan(ScanOutput &output) : output_(output) {}

    // Starts a scan with the next sample; one that is under way ends without its last windows.
    void start(uint32_t scan, uint32_t reference_um_per_s);

    // Closes the open batch. The scan ends when that batch has its velocity; a second call ends it
    // with the last velocity received.
    void stop();

    // True from start() to stop(): samples belong to the scan.
    bool sampling() const { return state_ == State::Sampling; }

    void add(const Sample &sample);
    void add_lost();

    // Scales the batch that waits for this velocity; one before it that waits too uses the last
    // velocity received. Returns false when no such batch waits; then
    // late_velocities() or early_velocities() counts it.
    bool set_velocity(uint32_t scan, uint32_t batch, uint32_t velocity_um_per_s);

    uint32_t late_velocities() const { return late_velocities_; }
    uint32_t early_velocities() const { return early_velocities_; }

private:
    enum class State : uint8_t { Idle, Sampling, Stopped };
    struct Batch {
        uint8_t spikes[BATCH_SAMPLES][TAXELS];
        uint8_t samples, lost_samples;
    };

    void add_spikes(const uint8_t *spikes, bool lost);
    bool waiting() const { return scaled_batches_ < open_batch_; }
    void close_batch();
    void scale_waiting(uint32_t velocity_um_per_s, VelocitySource source);
    void scale_without_velocity();
    void add_to_window(uint32_t window, const uint8_t *spikes);
    void close_window();
    void end_if_complete();

    ScanOutput &output_;
    State state_ = State::Idle;
    ScaledTime time_;
    WindowReport window_ = {};
    Batch batches_[2] = {};
    uint32_t scan_ = 0;
    uint16_t samples_left_ = 0;
    uint32_t open_batch_ = 0;     // its number; after a stop, that of the batch that does not follow
    uint32_t scaled_batches_ = 0;  // batches from here to open_batch_ wait: at most one, then two
    bool has_velocity_ = false;
    uint32_t velocity_um_per_s_ = 0;  // the last one received in this scan
    uint32_t late_velocities_ = 0, early_velocities_ = 0;
};

#endif
