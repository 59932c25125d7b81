#include "wire.h"

#include <string.h>

#include "cobs.h"
#include "crc32.h"

namespace {

const uint16_t MAGIC = 0x5247;

// Appends little-endian numbers to a body.
class BodyWriter {
public:
    explicit BodyWriter(uint8_t type) { put(type, 1); }

    void put(uint64_t value, uint8_t bytes)
    {
        for (; bytes; bytes--, value >>= 8) body_[size_++] = uint8_t(value);
    }

    void put_double(double value)
    {
        uint64_t bits;
        memcpy(&bits, &value, sizeof bits);
        put(bits, sizeof bits);
    }

    // Appends `bits` low bits of each value, the lowest bits first.
    template <typename T> void put_bits(const T (&values)[TAXELS], uint8_t bits)
    {
        for (uint8_t i = 0; i < TAXELS; i++) {
            pending_ |= uint32_t(values[i]) << pending_bits_;
            for (pending_bits_ += bits; pending_bits_ >= 8; pending_bits_ -= 8, pending_ >>= 8)
                put(pending_, 1);
        }
    }

    void put_pending_bits()
    {
        if (pending_bits_) put(pending_, 1);
    }

    WireFrame frame()
    {
        WireFrame wire;
        const uint8_t body_size = size_;
        put(crc32(body_, body_size), CRC_SIZE);
        wire.size = cobs_encode(body_, size_, wire.bytes);
        return wire;
    }

private:
    uint8_t body_[MAX_BODY + CRC_SIZE];
    uint8_t size_ = 0;
    uint32_t pending_ = 0;
    uint8_t pending_bits_ = 0;
};

// Takes little-endian numbers from a body.
class BodyReader {
public:
    explicit BodyReader(const uint8_t *at) : at_(at) {}
    uint8_t u8() { return uint8_t(take(1)); }
    uint16_t u16() { return uint16_t(take(2)); }
    uint32_t u32() { return uint32_t(take(4)); }

    double f64()
    {
        const uint64_t bits = take(8);
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }

private:
    uint64_t take(uint8_t bytes)
    {
        uint64_t value = 0;
        for (uint8_t i = 0; i < bytes; i++) value |= uint64_t(*at_++) << (8 * i);
        return value;
    }

    const uint8_t *at_;
};

void put_ranges(BodyWriter &body, const Ranges &ranges)
{
    for (uint16_t low : ranges.low) body.put(low, 2);
    for (uint16_t high : ranges.high) body.put(high, 2);
}

void read_ranges(BodyReader &body, Ranges &ranges)
{
    for (uint16_t &low : ranges.low) low = body.u16();
    for (uint16_t &high : ranges.high) high = body.u16();
}

// CRC-32 of a gain as its parts carry it: the shift, then all gains.
uint32_t gain_crc(const ForceGain &gain)
{
    uint8_t bytes[1 + 2 * (GAIN_STEPS + 1)], size = 0;
    bytes[size++] = gain.shift;
    for (uint16_t one : gain.gains) {
        bytes[size++] = uint8_t(one);
        bytes[size++] = uint8_t(one >> 8);
    }
    return crc32(bytes, size);
}

// Bytes of a request's body, its type included; 0: there is no such request.
uint8_t request_size(uint8_t type)
{
    switch (RequestType(type)) {
    case RequestType::Identify:
    case RequestType::ReadSettings: return 1;
    case RequestType::SetRanges: return 1 + 4 * TAXELS;
    case RequestType::SetReference:
    case RequestType::Start:
    case RequestType::Stop: return 1 + 4;
    case RequestType::Velocity: return 1 + 12;
    case RequestType::SetMean: return 1 + 1 + 8 * TAXELS;
    case RequestType::SetGain: return 1 + 2 + 2 * PART_GAINS;
    }
    return 0;
}

}  // namespace

WireFrame write_identity()
{
    BodyWriter body(TYPE_IDENTITY);
    body.put(MAGIC, 2);
    body.put(WIRE_VERSION, 1);
    body.put(BOARD_FINGER, 1);
    body.put(FIRMWARE_MAJOR << 8 | FIRMWARE_MINOR, 2);
    body.put(BUILD_HASH, 4);
    body.put(TAXELS, 1);
    body.put(1000, 2);  // samples a second
    body.put(BATCH_SAMPLES, 1);
    return body.frame();
}

WireFrame write_data(const Sample &sample, uint32_t counter, uint8_t flags)
{
    BodyWriter body(TYPE_DATA);
    body.put(counter, 2);
    body.put(flags, 1);
    body.put_bits(sample.reading, 10);
    body.put_bits(sample.spikes, 3);
    body.put_pending_bits();
    return body.frame();
}

WireFrame write_status(const Status &status)
{
    BodyWriter body(TYPE_STATUS);
    body.put(WIRE_VERSION, 1);
    body.put(status.samples, 4);
    body.put(status.lost_samples, 4);
    body.put(status.late_velocities, 4);
    body.put(status.early_velocities, 4);
    body.put(status.damaged_requests, 4);
    body.put(status.damaged_frames, 4);
    body.put(status.dropped_frames, 4);
    return body.frame();
}

WireFrame write_settings(const Settings &settings)
{
    BodyWriter body(TYPE_SETTINGS);
    put_ranges(body, settings.ranges);
    body.put(settings.reference_um_per_s, 4);
    body.put(gain_crc(settings.gain), 4);
    return body.frame();
}

WireFrame write_answer(RequestType type, Result result, uint32_t scan)
{
    BodyWriter body(TYPE_ANSWER);
    body.put(uint8_t(type), 1);
    body.put(uint8_t(result), 1);
    body.put(scan, 4);
    return body.frame();
}

WireFrame write_batch(const BatchReport &batch)
{
    BodyWriter body(TYPE_BATCH);
    body.put(batch.scan, 4);
    body.put(batch.batch, 4);
    body.put(batch.velocity_um_per_s, 4);
    body.put(uint8_t(batch.source), 1);
    body.put(batch.samples, 1);
    body.put(batch.lost_samples, 1);
    body.put(batch.start_nm, 8);
    return body.frame();
}

WireFrame write_window(const WindowReport &window)
{
    BodyWriter body(TYPE_WINDOW);
    body.put(window.scan, 4);
    body.put(window.window, 2);
    body.put(window.real_ms, 2);
    for (uint16_t spikes : window.spikes) body.put(spikes, 2);
    return body.frame();
}

WireFrame write_scan_ended(uint32_t scan)
{
    BodyWriter body(TYPE_SCAN_ENDED);
    body.put(scan, 4);
    return body.frame();
}

WireFrame write_prediction(const Prediction &prediction)
{
    BodyWriter body(TYPE_PREDICTION);
    body.put(prediction.scan, 4);
    body.put(prediction.best, 1);
    body.put(prediction.classes, 1);
    for (uint8_t i = 0; i < prediction.classes; i++) body.put_double(prediction.discriminants[i]);
    return body.frame();
}

bool read_request(const uint8_t *body, uint8_t size, Request &request)
{
    if (size == 0 || size != request_size(body[0])) return false;
    request.type = RequestType(body[0]);
    BodyReader reader(body + 1);
    switch (request.type) {
    case RequestType::Identify:
    case RequestType::ReadSettings: break;
    case RequestType::SetRanges: read_ranges(reader, request.ranges); break;
    case RequestType::SetReference: request.reference_um_per_s = reader.u32(); break;
    case RequestType::Start:
    case RequestType::Stop: request.scan = reader.u32(); break;
    case RequestType::Velocity:
        request.scan = reader.u32();
        request.batch = reader.u32();
        request.velocity_um_per_s = reader.u32();
        break;
    case RequestType::SetMean:
        request.window = reader.u8();
        for (double &mean : request.mean) mean = reader.f64();
        break;
    case RequestType::SetGain:
        request.part = reader.u8();
        request.shift = reader.u8();
        for (uint16_t &gain : request.gains) gain = reader.u16();
        break;
    }
    return true;
}
