#include "chip_boot.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>

extern uint8_t _end;  // linker: first byte behind the variables

namespace {

constexpr uint8_t PAINT = 0xc5;
constexpr uint8_t CHECK_SEED = 0x5a;
constexpr uint8_t LOOK_BYTES = 32;

struct Place {
    uint16_t count;
    uint8_t check;
};

Place EEMEM places[2];
uint16_t free_bytes = RAMEND;

// A reset keeps this memory, which no bootloader uses: what the program was doing when it ended.
constexpr uint32_t WATCHED = 0x57a7c4ed;
constexpr uint8_t HUNG_FRAMES = 32;  // half the watchdog's time

__attribute__((section(".noinit"))) uint32_t watched;  // WATCHED: the watchdog was on
__attribute__((section(".noinit"))) bool was_watched;
__attribute__((section(".noinit"))) uint8_t saved_mcusr;
__attribute__((section(".noinit"))) uint8_t saved_r2;

uint8_t check_of(uint16_t count) {
    return uint8_t(CHECK_SEED ^ count ^ (count >> 8));
}

bool load(uint8_t which, uint16_t &count) {
    count = eeprom_read_word(&places[which].count);
    return eeprom_read_byte(&places[which].check) == check_of(count);
}

}  // namespace

__attribute__((section(".noinit"))) volatile uint8_t unkicked_frames;

void watch_begins() {
    unkicked_frames = 0;
    watched = WATCHED;
}

// Before the C runtime clears anything: keep the reset cause, stop a watchdog that still runs.
// Optiboot clears MCUSR; a hang is then known from the frames that nobody took, unless interrupts
// were off and nothing counted.
extern "C" void save_reset_cause() __attribute__((naked, used, section(".init3")));
extern "C" void save_reset_cause() {
    cli();
    saved_mcusr = MCUSR;
    MCUSR = 0;
    wdt_disable();
    was_watched = watched == WATCHED;
    const bool hung = was_watched && unkicked_frames >= HUNG_FRAMES;
    if (hung && !(saved_mcusr & _BV(PORF))) saved_mcusr |= _BV(WDRF);
    watched = 0;
}

// Newer Optiboots hand their copy of MCUSR over in r2; the 4.4 that Arduino ships leaves r2 alone.
extern "C" void save_r2() __attribute__((naked, used, section(".init0")));
extern "C" void save_r2() {
    __asm__ volatile("sts %0, r2" : : "i"(&saved_r2));
}

extern "C" void paint_stack() __attribute__((naked, used, section(".init1")));
extern "C" void paint_stack() {
    __asm__ volatile(
        "    ldi r30, lo8(_end)\n"
        "    ldi r31, hi8(_end)\n"
        "    ldi r24, %0\n"
        "    ldi r25, hi8(%1)\n"
        "1:  st Z+, r24\n"
        "    cpi r30, lo8(%1)\n"
        "    cpc r31, r25\n"
        "    brne 1b\n"
        :
        : "i"(PAINT), "i"(RAMEND + 1));
}

uint8_t reset_cause() {
    if (saved_mcusr) return saved_mcusr;
    const bool is_cause = !(saved_r2 & 0xf0) && (was_watched || !(saved_r2 & _BV(WDRF)));
    return is_cause ? saved_r2 : 0;
}

uint16_t count_boot() {
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

uint16_t free_stack_bytes() {
    return free_bytes;
}

void look_at_stack() {
    static const uint8_t *at = &_end;
    for (uint8_t left = LOOK_BYTES; left; left--, at++) {
        if (*at == PAINT) continue;
        free_bytes = uint16_t(at - &_end);
        at = &_end;
        return;
    }
}
