// The taxel board's variant: everything that another board or wiring would change.
//
// Arduino Uno, ATmega328P at 16 MHz, 5 V. Three driven lines cross six analog inputs, each with
// a divider resistor to ground; a taxel under pressure has less resistance and reads higher.
#ifndef TAXELS_BOARD_H
#define TAXELS_BOARD_H

#include <stdint.h>

const uint8_t LINES = 3;
const uint8_t INPUTS = 6;
const uint8_t TAXELS = LINES * INPUTS;
const uint8_t SLOTS = 20;           // 18 taxels, then two for the bandgap
const uint16_t SLOT_CYCLES = 800;   // 20 × 800 cycles are 1 ms exactly
const uint16_t RATE_HZ = 1000;
const uint8_t STATUS_EVERY = 100;   // frames

const uint8_t FIRMWARE_MAJOR = 1;
const uint8_t FIRMWARE_MINOR = 0;

// Lines D4, D5, D6 = PD4 … PD6; an undriven line is held low, never floating.
const uint8_t LINE_SHIFT = 4;
const uint8_t LINE_MASK = 0x70;
// The other pins of port D are unused inputs (D2, D3, D7) and RX: pulled up, so none floats.
const uint8_t PORTD_REST = 0x8D;

const uint8_t SYNC_MASK = 0x01;     // D8 = PB0, also the input capture pin of timer 1
const uint8_t INDEX_MASK = 0x02;    // D9 = PB1

const uint16_t BANDGAP_MV = 1100;
const uint8_t BANDGAP_MUX = 0x0E;

// 16 MHz, double speed: 500 kbaud without error (ATmega328P data sheet, table of UBRR).
#ifndef UBRR_VALUE
#define UBRR_VALUE 3
#endif

#ifndef BUILD_HASH
#define BUILD_HASH 0UL  // the Arduino IDE does not compute one
#endif

#endif
