// Where the wires go on the Arduino Mega 2560. Port letter and bit of each signal, and the
// few accesses that more than one file needs.
#ifndef CHIP_PINS_H
#define CHIP_PINS_H

#include <avr/io.h>

namespace pins {

constexpr uint8_t STEP = _BV(PB5);          // D11, OC1A
constexpr uint8_t DIRECTION = _BV(PA0);     // D22
constexpr uint8_t STEPPER_OFF = _BV(PA1);   // D23, the driver's enable is active low
constexpr uint8_t SYNC = _BV(PA2);          // D24
constexpr uint8_t INDEX = _BV(PE4);         // D2, INT4, high at the mark
constexpr uint8_t ESTOP = _BV(PE5);         // D3, INT5, closed to ground, high when tripped
constexpr uint8_t LOADCELL_DATA = _BV(PD2); // D19, INT2
constexpr uint8_t LOADCELL_CLOCK = _BV(PE3);// D5
constexpr uint8_t PRESS = _BV(PH3);         // D6, OC4A
constexpr uint8_t LIFT = _BV(PH4);          // D7, OC4B
constexpr uint8_t BRIDGE_ON = _BV(PH5);     // D8
constexpr uint8_t END_UP = _BV(PC7);        // D30, closed to ground, high at the end
constexpr uint8_t END_DOWN = _BV(PC6);      // D31

}  // namespace pins

#endif  // CHIP_PINS_H
