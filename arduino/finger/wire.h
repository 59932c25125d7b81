// The frames of docs/reference/finger-wire.md: values to wire bytes and back. Knows no register.
//
// The framing is the taxel board's: COBS of the body and its CRC-32, then a zero byte.
#ifndef FINGER_WIRE_H
#define FINGER_WIRE_H

#include <stdint.h>

#include "classifier.h"
#include "scan.h"

const uint8_t WIRE_VERSION = 2;
const uint8_t BOARD_FINGER = 3;
const uint8_t FIRMWARE_MAJOR = 1;
const uint8_t FIRMWARE_MINOR = 1;

#ifndef BUILD_HASH
#define BUILD_HASH 0UL  // the Arduino IDE does not compute one
#endif

// Host to board.
enum class RequestType : uint8_t {
    Identify = 0x20,
    ReadSettings = 0x21,
    SetRanges = 0x22,
    SetReference = 0x23,
    Start = 0x24,
    Velocity = 0x25,
    Stop = 0x26,
    SetMean = 0x27,
    SetGain = 0x28,
};

// Board to host.
const uint8_t TYPE_IDENTITY = 0x30;
const uint8_t TYPE_DATA = 0x31;
const uint8_t TYPE_STATUS = 0x32;
const uint8_t TYPE_SETTINGS = 0x33;
const uint8_t TYPE_ANSWER = 0x34;
const uint8_t TYPE_BATCH = 0x35;
const uint8_t TYPE_WINDOW = 0x36;
const uint8_t TYPE_SCAN_ENDED = 0x37;
const uint8_t TYPE_PREDICTION = 0x38;

// Bits of a data frame's flags.
const uint8_t FLAG_IN_SCAN = 1 << 0;
const uint8_t FLAG_FIRST = 1 << 1;       // the first sample of a scan
const uint8_t FLAG_LOST_BEFORE = 1 << 2; // samples before this one are lost

enum class Result : uint8_t {
    Ok = 0,
    WrongValue = 1,
    Scanning = 2,    // settings do not change during a scan
    NotWaiting = 3,  // no batch waits for this velocity
    NoModel = 4,     // this image has no classifier
};

// A gain has more numbers than a frame: it comes in parts.
const uint8_t GAIN_PARTS = 5, PART_GAINS = (GAIN_STEPS + 1) / GAIN_PARTS;

const uint8_t CRC_SIZE = 4;
const uint8_t MAX_BODY = 80;
const uint8_t MAX_WIRE = MAX_BODY + CRC_SIZE + 2;

struct Request {
    RequestType type;
    Ranges ranges;                       // of SetRanges
    uint32_t reference_um_per_s;         // of SetReference
    uint32_t scan, batch, velocity_um_per_s;  // of Start, Velocity and Stop
    uint8_t window;                      // of SetMean
    double mean[TAXELS];                 // of SetMean, spikes/s
    uint8_t part, shift;                 // of SetGain
    uint16_t gains[PART_GAINS];          // of SetGain
};

struct Settings {
    const Ranges &ranges;
    uint32_t reference_um_per_s;
    const ForceGain &gain;
};

struct Status {
    uint32_t samples, lost_samples;
    uint32_t late_velocities, early_velocities;
    uint32_t damaged_requests, damaged_frames, dropped_frames;
};

// A complete frame, closing zero included.
struct WireFrame {
    uint8_t bytes[MAX_WIRE];
    uint8_t size;
};

WireFrame write_identity();
WireFrame write_data(const Sample &sample, uint32_t counter, uint8_t flags);
WireFrame write_status(const Status &status);
WireFrame write_settings(const Settings &settings);
WireFrame write_answer(RequestType type, Result result, uint32_t scan);
WireFrame write_batch(const BatchReport &batch);
WireFrame write_window(const WindowReport &window);
WireFrame write_scan_ended(uint32_t scan);
WireFrame write_prediction(const Prediction &prediction);

// Reads the body of a request. Returns false when its type or its size is unknown.
bool read_request(const uint8_t *body, uint8_t size, Request &request);

#endif
