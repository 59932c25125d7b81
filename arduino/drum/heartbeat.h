// Time since the last heartbeat of the computer.
#ifndef HEARTBEAT_H
#define HEARTBEAT_H

#include <stdint.h>

class Heartbeat {
  public:
    // Takes a received value; only a change is a beat, so a repeated frame does not count.
    void seen(uint16_t value) {
        if (value != value_) age_ms_ = 0;
        value_ = value;
    }
    // Supervision begins: a computer that arms the drum is alive.
    void restart() { age_ms_ = 0; }
    void tick() {
        if (age_ms_ < 60000) ++age_ms_;
    }
    bool silent(uint16_t limit_ms) const { return age_ms_ >= limit_ms; }
    uint16_t value() const { return value_; }

  private:
    uint16_t value_ = 0;
    uint16_t age_ms_ = 0;
};

#endif  // HEARTBEAT_H
