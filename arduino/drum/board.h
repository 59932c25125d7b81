// The variant of the drum this image is built for: where the wires go, which driver, actuator,
// amplifier and drum hang on them.
//
// Arduino Mega 2560 at 16 MHz. Another rig changes this file and nothing elsewhere, or brings a
// header of its own (-DVARIANT='"…/other.h"'). arduino/README.md has the drawing and lists
// the pins that depend on a timer or an interrupt of the chip.
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

#ifdef __AVR__  // the PC tests have no pins
#include <avr/io.h>

namespace pins {

constexpr uint8_t STEP = _BV(PB5);          // D11, OC1A
constexpr uint8_t DIRECTION = _BV(PA0);     // D22
constexpr uint8_t STEPPER_ENABLE = _BV(PA1);// D23
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
#endif

namespace board {

// Stepper driver: false where low switches it on. Its pull resistor goes to the other level.
constexpr bool STEPPER_ENABLE_HIGH = false;

// Drum: 200 full steps, a 4:1 belt, 400 mm of texture a turn.
constexpr uint8_t MICROSTEPS = 16;
constexpr uint16_t STEPS_PER_TURN = 200 * MICROSTEPS * 4;
constexpr uint32_t NM_PER_TURN = 400000000UL;

// Actuator: speed at full duty, time constant of its speed, travel read by its potentiometer, and
// how near to an end the potentiometer may come.
constexpr float ACTUATOR_MAX_MM_S = 10.0f;
constexpr float ACTUATOR_LAG_S = 0.030f;
constexpr uint16_t ACTUATOR_TRAVEL_UM = 50000;
constexpr uint16_t ACTUATOR_END_UM = 300;

// Its potentiometer of 10 kOhm with 470 Ohm at each end and 1 MOhm from the wiper to ground: readings
// at the ends of the travel, and readings that only a broken or shorted wire gives.
constexpr uint16_t POSITION_TOP_RAW = 44, POSITION_BOTTOM_RAW = 979;
constexpr uint16_t POSITION_BROKEN_LOW = 22, POSITION_BROKEN_HIGH = 1000;

// Load-cell amplifier: an HX711 with its RATE pin high, and low. A conversion shows the force of the
// delay ago. LOADCELL_SLOW is the pin's level until settings say otherwise.
constexpr uint32_t LOADCELL_PERIOD_US = 12500, LOADCELL_SLOW_PERIOD_US = 100000;
constexpr float LOADCELL_DELAY_S = 0.006f, LOADCELL_SLOW_DELAY_S = 0.050f;
constexpr bool LOADCELL_SLOW = false;

// Force that no setting lets pass, and the cell by which it is judged in raw counts. A cell that
// counts otherwise moves the limit by as much: put its scale here, to within a fifth.
constexpr uint16_t MOST_FORCE_G = 2000;
constexpr uint16_t UG_PER_COUNT = 2400;

// Bits of Signal that hold until settings say otherwise. Set an emergency stop that closes when it is
// pressed, or a missing one, here: a board whose stop reads open refuses such a setting.
constexpr uint8_t SIGNALS_FITTED = 0x1f;
constexpr uint8_t SIGNALS_INVERTED = 0;

}  // namespace board

#endif  // BOARD_H
