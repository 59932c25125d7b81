// The taxel board on the PC: the chip's firmware core with simulated hardware that counts frames.
//
// The bench passes the readings of whole frames; edges of sync and index precede the frames in
// which they occur. Times are cycles of the board since the start of its first frame.
#ifndef HOST_TAXEL_BOARD_H
#define HOST_TAXEL_BOARD_H

#include <stdint.h>

#include <deque>
#include <memory>

#include "../serial_line.h"
#include "taxel_io.h"
#include "ports.h"     // functions that the core calls
#include "talk.h"      // the firmware core

class TaxelBoard {
public:
    // Resets and boots, with the reset cause in the chip's MCUSR.
    void boot(uint8_t reset_cause);
    // An edge of sync or index at a cycle, in rising order.
    void edge(EdgeOf signal, bool level, uint64_t cycle);
    // Closes frames with these readings, one row of TAXELS a frame, and sends them.
    void run(const uint16_t *readings, int32_t frames);
    // Closes frames without sending; their flags and edges are in io.
    void close(int32_t frames);
    void receive(const uint8_t *bytes, int32_t count);

    TaxelIO io = {.supply_mv = 5000, .tx_count = 0, .overflows = 0, .flags = {}, .edges = {},
                  .tx = {}};

    // Implementation of ports.h for the running board.
    bool send(const uint8_t *bytes, uint8_t size, uint8_t kept_free);
    bool take(uint8_t &byte);
    void report(Status &status) const;
    uint8_t reset_cause() const { return reset_cause_; }
    void ask_spare(uint16_t answer) { spare_ = answer; }
    uint16_t spare() const { return spare_; }

private:
    struct Edge {
        EdgeOf signal;
        bool level;
        uint64_t cycle;
    };
    static constexpr uint64_t FRAME_CYCLES = uint64_t(SLOTS) * SLOT_CYCLES;
    static constexpr double BYTE_CYCLES = 10 * 8.0 * (UBRR_VALUE + 1);
    static constexpr uint64_t SEND_SIZE = 127;  // room in the ring of the chip's transmitter

    Frame close_frame(int32_t row);
    void count(const Edge &edge, Frame &frame);

    std::unique_ptr<Talk> talk_;
    SerialLine line_{BYTE_CYCLES};
    std::deque<Edge> edges_;
    std::deque<uint8_t> requests_;
    uint32_t samples_ = 0;
    uint64_t cycle_ = 0;
    uint16_t sync_rises_ = 0, marks_ = 0, spare_ = 0, boots_ = 0;
    uint8_t reset_cause_ = 0;
    bool sync_level_ = false;
};

#endif  // HOST_TAXEL_BOARD_H
