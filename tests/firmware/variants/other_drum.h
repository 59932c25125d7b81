// A drum of 360 mm at 8 microsteps, whose driver is switched on by high, on other pins, with a
// slower actuator of 40 mm, its ends the other way round, and an HX711 at 10 samples a second.
#ifndef BOARD_H
#define BOARD_H

#include <avr/io.h>
#include <stdint.h>

namespace pins {

constexpr uint8_t STEP = _BV(PB5);
constexpr uint8_t DIRECTION = _BV(PA3);
constexpr uint8_t STEPPER_ENABLE = _BV(PA4);
constexpr uint8_t SYNC = _BV(PA5);
constexpr uint8_t INDEX = _BV(PE4);
constexpr uint8_t ESTOP = _BV(PE5);
constexpr uint8_t LOADCELL_DATA = _BV(PD2);
constexpr uint8_t LOADCELL_CLOCK = _BV(PE3);
constexpr uint8_t PRESS = _BV(PH3);
constexpr uint8_t LIFT = _BV(PH4);
constexpr uint8_t BRIDGE_ON = _BV(PH5);
constexpr uint8_t END_UP = _BV(PC6);
constexpr uint8_t END_DOWN = _BV(PC7);

}  // namespace pins

namespace board {

constexpr bool STEPPER_ENABLE_HIGH = true;
constexpr uint16_t STEPS_PER_TURN = 200 * 8 * 4;
constexpr uint32_t NM_PER_TURN = 360000000UL;
constexpr float ACTUATOR_MAX_MM_S = 6.0f;
constexpr float ACTUATOR_LAG_S = 0.045f;
constexpr uint16_t ACTUATOR_TRAVEL_UM = 40000;
constexpr uint16_t ACTUATOR_END_UM = 500;
constexpr uint16_t POSITION_TOP_RAW = 44, POSITION_BOTTOM_RAW = 979;
constexpr uint16_t POSITION_BROKEN_LOW = 22, POSITION_BROKEN_HIGH = 1000;
constexpr uint32_t LOADCELL_PERIOD_US = 12500, LOADCELL_SLOW_PERIOD_US = 100000;
constexpr float LOADCELL_DELAY_S = 0.006f, LOADCELL_SLOW_DELAY_S = 0.050f;
constexpr bool LOADCELL_SLOW = true;
constexpr uint16_t MOST_FORCE_G = 1500;
constexpr uint16_t UG_PER_COUNT = 2400;
constexpr uint8_t SIGNALS_FITTED = 0x1f;
constexpr uint8_t SIGNALS_INVERTED = 0;

}  // namespace board

#endif
