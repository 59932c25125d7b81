// How long ago the computer last showed that it is alive.
#ifndef HEARTBEAT_H
#define HEARTBEAT_H

#include <stdint.h>

class Heartbeat {
  public:
    // A value came in; only a change is a beat, so that a repeated frame keeps nothing alive.
    void seen(uint16_t value) {
        if (value != value_) age_ms_ = 0;
        value_ = value;
    }
    // Supervision begins now: whoever arms the drum is alive.
    void restart() { age_ms_ = 0; }
    void tick() {
        if (age_ms_ < 60000) ++age_ms_;
    }
    bool silent(uint16_t limit_ms) const {
#ifdef HEARTBEAT_IGNORED  // a broken image that the tests must catch
        limit_ms = 65535;
#endif
        return age_ms_ >= limit_ms;
    }
    uint16_t value() const { return value_; }

  private:
    uint16_t value_ = 0;
    uint16_t age_ms_ = 0;
};

#endif  // HEARTBEAT_H
