// The variant of the drum this image is built for: what is screwed and soldered together.
// Another drum, driver or actuator changes numbers here and nothing elsewhere.
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

#ifndef BUILD_HASH
#define BUILD_HASH 0UL  // the Arduino IDE passes none
#endif

#ifndef MICROSTEPS
#define MICROSTEPS 16
#endif

namespace board {

constexpr uint8_t FIRMWARE_MAJOR = 0;
constexpr uint8_t FIRMWARE_MINOR = 1;

constexpr uint32_t CLOCK_HZ = 16000000UL;

// Drum: 200 full steps, 16 microsteps, a 4:1 belt, 400 mm of texture a turn.
constexpr uint16_t STEPS_PER_TURN = 200 * MICROSTEPS * 4;
constexpr uint32_t NM_PER_STEP = 400000000UL / STEPS_PER_TURN;

// Actuator: speed at full duty, time constant of its speed, travel read by its potentiometer, and
// how near to an end the potentiometer may come.
constexpr float ACTUATOR_MAX_MM_S = 10.0f;
constexpr float ACTUATOR_LAG_S = 0.030f;
constexpr uint16_t ACTUATOR_TRAVEL_UM = 50000;
constexpr uint16_t ACTUATOR_END_UM = 300;

// Load-cell amplifier: HX711 at its 80 samples a second; a conversion shows the force of this long
// ago. One on a board with RATE to ground gives 10: then 100000 and 0.050.
constexpr uint16_t LOADCELL_PERIOD_US = 12500;
constexpr float LOADCELL_DELAY_S = 0.006f;

}  // namespace board

#endif  // BOARD_H
