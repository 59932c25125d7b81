// The number of this boot, which EEPROM keeps, and the reset's cause where Optiboot passes it on.
#include <avr/eeprom.h>
#include <avr/io.h>

#include "chip.h"
#include "chip_reset.h"
#include "ports.h"

namespace {

constexpr uint8_t CHECK_SEED = 0x5a;

struct Place {
    uint16_t count;
    uint8_t check;
};

Place EEMEM places[2];
uint8_t saved_r2 __attribute__((section(".noinit")));

uint8_t check_of(uint16_t count) {
    return uint8_t(CHECK_SEED ^ count ^ (count >> 8));
}

bool load(uint8_t which, uint16_t &count) {
    count = eeprom_read_word(&places[which].count);
    return eeprom_read_byte(&places[which].check) == check_of(count);
}

}  // namespace

// Newer Optiboots hand their copy of MCUSR over in r2; the 4.4 that Arduino ships leaves r2 alone.
extern "C" void save_r2() __attribute__((naked, used, section(".init0")));
extern "C" void save_r2() {
    __asm__ volatile("sts %0, r2" : : "i"(&saved_r2));
}

uint8_t reset_cause() {
    const uint8_t cause = reset::cause();
    if (cause) return cause;
    const bool is_cause = !(saved_r2 & 0xf0) && (reset::was_watched() || !(saved_r2 & _BV(WDRF)));
    return is_cause ? saved_r2 : 0;
}

// Two places with a check byte each: power lost while writing costs one count.
uint16_t boot::count() {
    uint16_t count[2];
    bool good[2] = {load(0, count[0]), load(1, count[1])};
    uint8_t newer = !good[0] || (good[1] && int16_t(count[1] - count[0]) > 0) ? 1 : 0;
    uint16_t boots = uint16_t((good[newer] ? count[newer] : 0) + 1);
    Place *older = &places[!newer];
    eeprom_update_byte(&older->check, uint8_t(~check_of(boots)));
    eeprom_update_word(&older->count, boots);
    eeprom_update_byte(&older->check, check_of(boots));
    return boots;
}

uint16_t free_stack_bytes() { return stack::unused_bytes(); }
