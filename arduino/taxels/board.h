// The taxel board's variant: what is soldered to it, and all that another wiring would change.
//
// Arduino Uno, ATmega328P at 16 MHz, 5 V. Three driven lines cross six analog inputs, each with
// a divider resistor; a taxel under pressure has less resistance. arduino/README.md has the
// drawing. The order of taxels on the sensor is not here but in rig.toml ([taxels] wiring).
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

// The sensor: a taxel where a line crosses an input. Frames, scan and self-test follow from these
// two; another sensor also needs its pins below, and [taxels] of rig.toml.
constexpr uint8_t LINES = 3;
constexpr uint8_t INPUTS = 6;
// Bits of port D, digital pins 4, 5 and 6; all lines must be on this port.
constexpr uint8_t LINE_BIT[LINES] = {4, 5, 6};
// Analog inputs A0 … A5.
constexpr uint8_t INPUT_CHANNEL[INPUTS] = {0, 1, 2, 3, 4, 5};

// true: the line that is read is high, the others low, the dividers go to ground, and pressure
// raises a reading. false: all of it the other way round; then rig.toml says pressure_raises =
// false.
constexpr bool DRIVE_HIGH = true;

// From each analog input to ground (or to 5 V). The self-test expects it; 100 to 47,000.
constexpr uint16_t DIVIDER_OHM = 10000;

// The wires from the drum board. One that is not there is neither read nor left floating.
constexpr bool SYNC_FITTED = true;
constexpr bool INDEX_FITTED = true;
constexpr uint8_t SYNC_MASK = 0x01;     // D8 = PB0, also the input capture pin of timer 1
constexpr uint8_t INDEX_MASK = 0x02;    // D9 = PB1

// 16 MHz, double speed: 500 kbaud without error (ATmega328P data sheet, table of UBRR).
constexpr uint8_t UBRR_VALUE = 3;

#endif  // BOARD_H
