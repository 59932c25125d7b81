// Modbus RTU slave, functions 3, 6, 16 and 23: bytes in, reply bytes out; no port, no clock.
//
// A frame ends by its function's length, because USB adapters split frames with gaps that the
// standard would take for an end. Only RESET_SILENCE_MS of silence resets the parser. After an
// invalid frame everything is dropped until that silence.
#ifndef MODBUS_H
#define MODBUS_H

#include <stdint.h>

#include "registers.h"  // what is read and written

class Modbus {
  public:
    static constexpr uint8_t MAX_REQUEST = 64;
    static constexpr uint16_t MAX_REPLY = 256;
    static constexpr uint8_t RESET_SILENCE_MS = 10;

    explicit Modbus(Registers &registers) : registers_(registers) {}

    // Takes one received byte; returns the length of the reply now in reply(), 0 for none.
    uint16_t take(uint8_t byte);
    // A byte was damaged: its frame is lost.
    void poison() { lost_ = true; }
    // Once a millisecond.
    void tick();

    // Computes the CRC first, which takes as long as serving the request: a separate round.
    const uint8_t *reply();
    uint16_t frames_seen() const { return frames_seen_; }
    uint16_t exceptions_sent() const { return exceptions_sent_; }
    uint16_t crc_errors() const { return crc_errors_; }

    static uint16_t crc_step(uint16_t crc, uint8_t byte);

  private:
    uint8_t length_by_function() const;
    bool complete() const;
    uint16_t serve();
    uint16_t finish(uint16_t length);
    uint16_t refuse(uint8_t code);
    uint16_t read_words(uint16_t address, uint16_t count);
    uint16_t serve_read();
    uint16_t serve_single();
    uint16_t serve_multiple();
    uint16_t serve_both();
    uint16_t field(uint8_t offset) const;

    Registers &registers_;
    uint8_t request_[MAX_REQUEST];
    uint8_t size_ = 0;
    uint8_t silence_ms_ = 0;
    bool lost_ = false;
    uint16_t crc_ = 0xffff;
    uint8_t reply_[MAX_REPLY];
    uint16_t unsealed_ = 0;  // bytes of a reply that has no CRC yet
    uint16_t frames_seen_ = 0, exceptions_sent_ = 0, crc_errors_ = 0;
};

#endif  // MODBUS_H
