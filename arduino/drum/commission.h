// Whether the board was set up with the settings that it has now.
//
// COMMISSION keeps a hash in the EEPROM: of the settings that say which wires are there and what a
// force is, and of the bench that the image is built for. With another hash, or none, APPROACH is
// refused. The hash outlives a reset and another image for the same bench.
#ifndef COMMISSION_H
#define COMMISSION_H

#include <stdint.h>

#include "bank.h"   // settings
#include "ports.h"  // the hash that was kept

class Commission {
  public:
    void configure(const Bank &bank);
    uint32_t hash() const { return hash_; }
    bool holds() const { return ports::commissioned() == hash_; }
    void keep() const { ports::commission(hash_); }

  private:
    uint32_t hash_ = 0;
};

#endif  // COMMISSION_H
