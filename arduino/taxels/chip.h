// Interfaces of the chip's files for main() and for each other; the brain uses only ports.h.
#ifndef CHIP_H
#define CHIP_H

#include <stdint.h>

#include "wire.h"  // frames

namespace boot {  // chip_boot.cpp: EEPROM
// Counts this boot and returns the number. Takes up to 14 ms: once, before sampling begins.
uint16_t count();
}  // namespace boot

namespace sampling {  // chip_sampling.cpp: timer 1 starts a conversion every 800 cycles by hardware
void begin();
extern volatile uint8_t frame_closed;  // by an interrupt, and not taken yet
const Frame &take_frame();             // the frame closed last; valid for 1 ms
}  // namespace sampling

namespace serial {  // chip_serial.cpp: USART0
void begin();
}  // namespace serial

#endif  // CHIP_H
