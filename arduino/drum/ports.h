// Hardware functions that the controller calls. The chip implements them (chip_*.cpp), and so do the
// virtual board (../host/drum) and the PC tests, which have a small model of the bench.
#ifndef PORTS_H
#define PORTS_H

#include <stdint.h>

#include "drum_map.h"     // where settings come from
#include "step_engine.h"  // motions

namespace ports {

struct SyncLine {
    uint32_t rise_us, fall_us;
    uint16_t count;
    bool high;
};

struct IndexMark {
    int32_t position;  // steps at the mark's leading edge, whichever way the drum turned
    uint16_t count;
};

struct Health {
    uint16_t late_ticks, longest_isr_us, free_stack_bytes, idle_permille;
    uint16_t boot_count, reset_cause;
};

uint32_t now_us();
Health health();

void enable_stepper(bool on);
void start(const Motion &motion);
void stop_gently();  // ramps down
void stop_at_once();
bool moving();
bool at_speed();
uint32_t step_interval();
int32_t position();
void shift_position(int32_t by);
SyncLine sync_line();
IndexMark index_mark();

// Bits of Signal: which optional wires are there at all, and which mean the opposite.
void wire_signals(uint8_t fitted, uint8_t inverted);
void enable_bridge(bool on);
void drive(int16_t permille);  // positive presses

// Settings that outlive the power. save() begins a write that takes a byte a tick.
// load() leaves the words alone where nothing whole was saved.
SettingsFrom load(uint16_t *words);
void save(const uint16_t *words);
bool saving();
// The hash that was last kept, 0 for none; commission() begins a write as save() does.
uint32_t commissioned();
void commission(uint32_t hash);
// The same of the place at which a force was last reached, with the hash of the settings then.
struct Place {
    uint32_t hash;
    uint16_t contact_um;
};
Place place();
void keep_place(const Place &place);
uint8_t stored_byte(uint16_t address);
bool store_ready();  // for another byte
void store_byte(uint16_t address, uint8_t byte);

}  // namespace ports

#endif  // PORTS_H
