// A serial line of a virtual board: bytes with their durations, stamped in cycles of the board.
#ifndef HOST_SERIAL_LINE_H
#define HOST_SERIAL_LINE_H

#include <stdint.h>

#include <deque>

struct StampedByte {
    uint64_t cycle;  // at which its stop bit ends
    uint8_t byte;
};

class SerialLine {
  public:
    explicit SerialLine(double byte_cycles) : byte_cycles_(byte_cycles) {}

    // Puts a byte on the line at a cycle, after those that are on it already.
    void put(uint8_t byte, uint64_t cycle) {
        if (free_ < static_cast<double>(cycle)) free_ = static_cast<double>(cycle);
        free_ += byte_cycles_;
        bytes_.push_back({static_cast<uint64_t>(free_), byte});
    }
    // The same for bytes of which only the duration matters.
    void pass(uint32_t count, uint64_t cycle) {
        if (free_ < static_cast<double>(cycle)) free_ = static_cast<double>(cycle);
        free_ += byte_cycles_ * count;
    }
    bool empty() const { return bytes_.empty(); }
    const StampedByte &first() const { return bytes_.front(); }
    void drop_first() { bytes_.pop_front(); }
    void clear() { bytes_.clear(); }

    // Cycle at which the last byte ends.
    uint64_t free_at() const { return static_cast<uint64_t>(free_); }
    // Bytes that have not left yet.
    uint64_t waiting(uint64_t cycle) const {
        const double left = free_ - static_cast<double>(cycle);
        return left > 0 ? static_cast<uint64_t>(left / byte_cycles_ + 0.999) : 0;
    }

  private:
    double byte_cycles_, free_ = 0;
    std::deque<StampedByte> bytes_;
};

#endif  // HOST_SERIAL_LINE_H
