// Interfaces of the chip's files for main() and for each other; the controller uses only ports.h.
#ifndef CHIP_H
#define CHIP_H

#include <stdint.h>

#include "loadcell.h"  // conversions

namespace clock {  // chip_clock.cpp: 1 kHz tick and microseconds
void begin();
uint8_t take_ticks();  // ticks since the last call
bool pending();        // some wait to be taken
uint32_t now_ms();
uint32_t micros_in_isr();
}  // namespace clock

namespace stepper {  // chip_stepper.cpp
void begin();
void cut();       // interrupts are off: no further pulse leaves the pin
void wire_index(bool inverted);
bool index_high();
void wire_sync(bool fitted, bool inverted);
bool breathing(); // called once a tick: the step interrupt comes when it should
}  // namespace stepper

namespace bridge {  // chip_bridge.cpp: H-bridge, potentiometer, end switches
void begin();
void cut();
void start_reading();       // once a tick; the reading is there at the next
uint16_t position_um();
uint16_t position_raw();
bool end_up();
bool end_down();
}  // namespace bridge

namespace estop {  // chip_estop.cpp
void begin();
void wire(bool fitted, bool inverted);
void check_in_isr();  // from the tick interrupt: an opening whose edge was lost
bool tripped();       // interrupts are off or it does not matter: outputs stay off
bool take();          // open now, or was since the last call
}  // namespace estop

namespace amplifier {  // chip_loadcell.cpp: HX711
void begin();
void look();  // once a tick: catches a ready edge that was missed
bool ready();
Conversion read();
}  // namespace amplifier

namespace serial {  // chip_serial.cpp: USART0
struct Received {
    uint8_t byte;
    bool damaged;
};
void begin();
bool available();
Received take();
void send(const uint8_t *bytes, uint16_t count);
}  // namespace serial

namespace health {  // chip_health.cpp: late ticks, longest interrupt, idle time, and the watchdog
void begin();
bool watchdog_reset();
void kick();           // the watchdog, when all have checked in
void count_late(uint8_t ticks);
void sleep_until_interrupt();  // called, and left, with interrupts off
}  // namespace health

namespace store {  // chip_store.cpp: EEPROM
void begin();
void tick();
uint16_t boot_count();
}  // namespace store

#endif  // CHIP_H
