#include "bank.h"

namespace {

// Heartbeat and command come first; they have no default.
constexpr uint16_t FIRST_KEPT = reg::signal_polarity;

bool is_wide(Kind kind) { return kind == Kind::U32 || kind == Kind::I32; }

int32_t value_of(const uint16_t *words, Kind kind) {
    switch (kind) {
        case Kind::U16: return words[0];
        case Kind::I16: return static_cast<int16_t>(words[0]);
        default:
            return static_cast<int32_t>(static_cast<uint32_t>(words[0]) << 16 | words[1]);
    }
}

bool inside(const Setting &setting, const uint16_t *words) {
    const int32_t value = value_of(words, setting.kind);
    if (value > -setting.least && value < setting.least) return false;
    return value >= setting.low && value <= setting.high;
}

}  // namespace

bool Bank::writable(uint16_t address, uint16_t count) const {
    uint16_t covered = 0;
    for (uint8_t i = 0; i < SETTING_COUNT; ++i) {
        const uint16_t first = flash::word_at(&SETTINGS[i].address);
        if (first + 1 < address) continue;
        if (first >= address && first - address >= count) break;
        const Kind kind = flash::load(&SETTINGS[i].kind);
        for (uint8_t w = 0; w <= is_wide(kind); ++w) {
            const uint16_t place = first + w;
            covered += place >= address && place - address < count;
        }
    }
    return covered == count;
}

bool Bank::in_bounds(uint16_t address, uint16_t count) const {
    for (uint8_t i = 0; i < SETTING_COUNT; ++i) {
        const uint16_t first = flash::word_at(&SETTINGS[i].address);
        if (first + 1 < address) continue;
        if (first >= address && first - address >= count) break;
        if (!inside(flash::load(&SETTINGS[i]), &words_[first])) return false;
    }
    return true;
}

Guard Bank::guard_of_change(uint16_t address, uint16_t count, const uint16_t *before) const {
    Guard strictest = Guard::None;
    for (uint8_t i = 0; i < SETTING_COUNT; ++i) {
        const uint16_t first = flash::word_at(&SETTINGS[i].address);
        if (first + 1 < address) continue;
        if (first >= address && first - address >= count) break;
        const Guard guard = flash::load(&SETTINGS[i].guard);
        if (guard <= strictest) continue;
        const bool wide = is_wide(flash::load(&SETTINGS[i].kind));
        for (uint16_t place = first; place <= first + wide; ++place) {
            const bool written = place >= address && place - address < count;
            if (written && words_[place] != before[place - address]) strictest = guard;
        }
    }
    return strictest;
}

int32_t Bank::wide(uint16_t address) const { return value_of(&words_[address], Kind::I32); }

void Bank::put_wide(uint16_t address, uint32_t value) {
    words_[address] = static_cast<uint16_t>(value >> 16);
    words_[address + 1] = static_cast<uint16_t>(value);
}

void Bank::restore_defaults() {
    for (uint8_t i = 0; i < SETTING_COUNT; ++i) {
        const Setting setting = flash::load(&SETTINGS[i]);
        if (setting.address < FIRST_KEPT) continue;
        if (is_wide(setting.kind)) put_wide(setting.address, setting.initial);
        else put(setting.address, static_cast<uint16_t>(setting.initial));
    }
}
