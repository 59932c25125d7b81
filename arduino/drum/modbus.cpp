#include "modbus.h"

#include "crc16_table.h"  // polynomial

namespace {

constexpr uint8_t READ = 3, WRITE_ONE = 6, WRITE = 16, READ_WRITE = 23;
constexpr uint8_t UNKNOWN_FUNCTION = 1, BAD_VALUE = 3;
constexpr uint8_t MIN_FRAME = 4;
constexpr uint8_t TOO_LONG = 255;
constexpr uint8_t MAX_READ = 125;

inline uint16_t crc_after(uint16_t crc, uint8_t byte) {
    return flash::word_at(&CRC16_OF_BYTE[static_cast<uint8_t>(crc ^ byte)]) ^ crc >> 8;
}

uint8_t total(uint16_t head, uint8_t data) {
    const uint16_t length = head + data + 2;
    return length > Modbus::MAX_REQUEST ? TOO_LONG : static_cast<uint8_t>(length);
}

}  // namespace

uint16_t Modbus::crc_step(uint16_t crc, uint8_t byte) { return crc_after(crc, byte); }

uint16_t Modbus::field(uint8_t offset) const {
    return static_cast<uint16_t>(request_[offset] << 8 | request_[offset + 1]);
}

// Bytes of the whole frame as far as they can be known yet; 0 while they cannot.
uint8_t Modbus::length_by_function() const {
    if (size_ < 2) return 0;
    switch (request_[1]) {
        case READ:
        case WRITE_ONE: return 8;
        case WRITE: return size_ < 7 ? 0 : total(7, request_[6]);
        case READ_WRITE: return size_ < 11 ? 0 : total(11, request_[10]);
        default: return 0;
    }
}

// A frame of a function not served here has no length to go by: it ends where its CRC fits.
bool Modbus::complete() const {
    const uint8_t function = request_[1];
    const bool served = function == READ || function == WRITE_ONE || function == WRITE ||
                        function == READ_WRITE;
    if (served) return length_by_function() == size_;
    return size_ >= MIN_FRAME && crc_ == 0;
}

uint16_t Modbus::take(uint8_t byte) {
    silence_ms_ = 0;
    if (lost_) return 0;
    request_[size_++] = byte;
    crc_ = crc_after(crc_, byte);
    const bool done = complete();
    if (!done) {
        lost_ = size_ == MAX_REQUEST || length_by_function() == TOO_LONG;
        return 0;
    }
    const bool good = crc_ == 0;
    uint16_t length = 0;
    if (!good) {
        ++crc_errors_;
        lost_ = true;
    } else if (request_[0] == UNIT) {
        ++frames_seen_;
        length = serve();
    }
    size_ = 0;
    crc_ = 0xffff;
    return length;
}

void Modbus::tick() {
    if (silence_ms_ < RESET_SILENCE_MS && ++silence_ms_ == RESET_SILENCE_MS) {
        if (size_ || lost_) crc_errors_ += !lost_;
        lost_ = false;
        size_ = 0;
        crc_ = 0xffff;
    }
}

uint16_t Modbus::serve() {
    reply_[0] = request_[0];
    reply_[1] = request_[1];
    switch (request_[1]) {
        case READ: return serve_read();
        case WRITE_ONE: return serve_single();
        case WRITE: return serve_multiple();
        case READ_WRITE: return serve_both();
        default: return refuse(UNKNOWN_FUNCTION);
    }
}

uint16_t Modbus::finish(uint16_t length) {
    unsealed_ = length;
    return length + 2;
}

const uint8_t *Modbus::reply() {
    if (!unsealed_) return reply_;
    uint16_t crc = 0xffff;
    for (uint16_t i = 0; i < unsealed_; ++i) crc = crc_after(crc, reply_[i]);
    reply_[unsealed_] = static_cast<uint8_t>(crc);
    reply_[unsealed_ + 1] = static_cast<uint8_t>(crc >> 8);
    unsealed_ = 0;
    return reply_;
}

uint16_t Modbus::refuse(uint8_t code) {
    ++exceptions_sent_;
    reply_[1] |= 0x80;
    reply_[2] = code;
    return finish(3);
}

uint16_t Modbus::read_words(uint16_t address, uint16_t count) {
    registers_.refresh();
    reply_[2] = static_cast<uint8_t>(2 * count);
    for (uint16_t i = 0; i < count; ++i) {
        const uint16_t word = registers_.read(address + i);
        reply_[3 + 2 * i] = static_cast<uint8_t>(word >> 8);
        reply_[4 + 2 * i] = static_cast<uint8_t>(word);
    }
    return finish(3 + 2 * count);
}

uint16_t Modbus::serve_read() {
    const uint16_t address = field(2), count = field(4);
    if (!count || count > MAX_READ) return refuse(BAD_VALUE);
    const Answer answer = registers_.check_read(address, count);
    if (answer != Answer::Ok) return refuse(static_cast<uint8_t>(answer));
    return read_words(address, count);
}

uint16_t Modbus::serve_single() {
    const Answer answer = registers_.write(field(2), 1, &request_[4]);
    if (answer != Answer::Ok) return refuse(static_cast<uint8_t>(answer));
    memcpy(reply_, request_, 6);
    return finish(6);
}

uint16_t Modbus::serve_multiple() {
    const uint16_t count = field(4);
    if (!count || request_[6] != 2 * count) return refuse(BAD_VALUE);
    const Answer answer = registers_.write(field(2), count, &request_[7]);
    if (answer != Answer::Ok) return refuse(static_cast<uint8_t>(answer));
    memcpy(reply_, request_, 6);
    return finish(6);
}

uint16_t Modbus::serve_both() {
    const uint16_t address = field(2), count = field(4), written = field(8);
    if (!count || count > MAX_READ || !written || request_[10] != 2 * written)
        return refuse(BAD_VALUE);
    Answer answer = registers_.check_read(address, count);
    if (answer == Answer::Ok) answer = registers_.write(field(6), written, &request_[11]);
    if (answer != Answer::Ok) return refuse(static_cast<uint8_t>(answer));
    return read_words(address, count);
}
