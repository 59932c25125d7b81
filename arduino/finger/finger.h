// The finger board: samples and requests in, frames out. Its clock is its samples.
#ifndef FINGER_FINGER_H
#define FINGER_FINGER_H

#include <stdint.h>

#include "classifier.h"
#include "frame_receiver.h"
#include "neurons.h"
#include "scan.h"
#include "wire.h"

// The line to the host; the board's hardware implements it.
class HostLine {
public:
    // Queues a whole frame, or nothing. Returns false when there is no room for it.
    virtual bool send(const uint8_t *bytes, uint8_t size) = 0;

protected:
    ~HostLine() = default;
};

class Finger final : private ScanOutput {
public:
    // A board without a model classifies nothing. The model must outlive the board.
    explicit Finger(HostLine &line, const ClassifierModel *model = nullptr);

    // Sends the identity. Call it once after a reset.
    void begin();

    // Takes the readings of the next millisecond, and how many milliseconds before it are lost.
    void take_sample(Sample &sample, uint16_t lost);

    // Takes a byte from the host.
    void receive(uint8_t byte);

    // Sets the number of damaged frames of the taxel board, for the status.
    void set_damaged_frames(uint32_t count) { damaged_frames_ = count; }

private:
    void window_closed(const WindowReport &window) override;
    void batch_scaled(const BatchReport &batch) override;
    void scan_ended(uint32_t scan) override;

    void send(const WireFrame &frame);
    void send_data(const Sample &sample, bool in_scan, bool lost_before);
    void send_status();
    void handle(const Request &request);
    Result set_ranges(const Ranges &ranges);
    Result set_reference(uint32_t reference_um_per_s);
    Result set_velocity(const Request &request);
    Result set_mean(const Request &request);
    Result set_gain(const Request &request);
    void start(uint32_t scan);

    HostLine &line_;
    const bool classifies_;
    Classifier classifier_;
    FrameReceiver receiver_;
    Neurons neurons_;
    Scan scan_;
    uint32_t reference_um_per_s_ = DEFAULT_REFERENCE_UM_PER_S;
    bool first_sample_ = false;
    uint32_t samples_ = 0, lost_samples_ = 0;
    uint32_t unknown_requests_ = 0, damaged_frames_ = 0, dropped_frames_ = 0;
};

#endif
