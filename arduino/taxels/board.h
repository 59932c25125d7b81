// The taxel board's variant: everything that another board or wiring would change.
//
// Arduino Uno, ATmega328P at 16 MHz, 5 V. Three driven lines cross six analog inputs, each with
// a divider resistor; a taxel under pressure has less resistance. arduino/README.md has the
// drawing. The order of taxels on the sensor is not here but in rig.toml ([taxels] wiring).
#ifndef TAXELS_BOARD_H
#define TAXELS_BOARD_H

#include <stdint.h>

const uint8_t FIRMWARE_MAJOR = 1;
const uint8_t FIRMWARE_MINOR = 1;

// --- what is soldered --------------------------------------------------------------------------

const uint8_t LINES = 3;
const uint8_t INPUTS = 6;
// Bits of port D, digital pins 4, 5 and 6; all lines must be on this port.
constexpr uint8_t LINE_BIT[LINES] = {4, 5, 6};
// Analog inputs A0 … A5.
constexpr uint8_t INPUT_CHANNEL[INPUTS] = {0, 1, 2, 3, 4, 5};

// true: the line that is read is high, the others low, the dividers go to ground, and pressure
// raises a reading. false: all of it the other way round; then rig.toml says pressure_raises =
// false.
const bool DRIVE_HIGH = true;

// From each analog input to ground (or to 5 V). The self-test expects it; 100 to 47,000.
const uint16_t DIVIDER_OHM = 10000;

// The wires from the drum board. One that is not there is neither read nor left floating.
const bool SYNC_FITTED = true;
const bool INDEX_FITTED = true;
const uint8_t SYNC_MASK = 0x01;     // D8 = PB0, also the input capture pin of timer 1
const uint8_t INDEX_MASK = 0x02;    // D9 = PB1

// 16 MHz, double speed: 500 kbaud without error (ATmega328P data sheet, table of UBRR).
#ifndef UBRR_VALUE
#define UBRR_VALUE 3
#endif

// --- what follows from it, and from the wire ---------------------------------------------------

const uint8_t TAXELS = LINES * INPUTS;
const uint8_t SLOTS = 20;           // 18 taxels, then two for the bandgap
const uint16_t SLOT_CYCLES = 800;   // 20 × 800 cycles are 1 ms exactly
const uint16_t RATE_HZ = 1000;
const uint8_t STATUS_EVERY = 100;   // frames

const uint8_t LINE_MASK = 1 << LINE_BIT[0] | 1 << LINE_BIT[1] | 1 << LINE_BIT[2];
const uint8_t TRANSMIT_MASK = 0x02;
// The rest of port D are unused inputs and the receiver: pulled up, so that none floats. Lines
// that are not driven are held at the dividers' side, never floating.
const uint8_t PORTD_IDLE =
    uint8_t(~(LINE_MASK | TRANSMIT_MASK)) | (DRIVE_HIGH ? 0 : LINE_MASK);

const uint8_t WATCHED_MASK = (SYNC_FITTED ? SYNC_MASK : 0) | (INDEX_FITTED ? INDEX_MASK : 0);

const uint16_t BANDGAP_MV = 1100;
const uint8_t BANDGAP_MUX = 0x0E;

#ifndef BUILD_HASH
#define BUILD_HASH 0UL  // the Arduino IDE does not compute one
#endif

#endif
