#include "bank.h"

namespace {

// The computer's own traffic; nothing of it is kept or defaulted.
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
#ifndef ANY_SCALE  // a broken image that the tests must catch
    if (value > -setting.least && value < setting.least) return false;
#endif
    return value >= setting.low && value <= setting.high;
}

}  // namespace

Answer Bank::check_read(uint16_t address, uint16_t count) const {
    const uint32_t end = static_cast<uint32_t>(address) + count;
    return end <= MAP_END ? Answer::Ok : Answer::NoRegister;
}

uint16_t Bank::read(uint16_t address) const {
    if (address < COUNTERS_END) return words_[address];
    return address < reg::ring_raw ? 0 : owner_.ring_word(address);
}

// Walks the settings that cover the words written; only those can have become wrong.
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

bool Bank::settings_valid() const { return in_bounds(SETTINGS_START, SETTINGS_WORDS); }

// The strictest guard of what differs now from what stood in these words before.
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

// Judges the words written, and gives the command among them. A command is judged by settings
// that hold: one that comes together with a change of a guarded setting is refused.
Answer Bank::take(uint16_t address, uint16_t count, const uint16_t *before) {
    if (!in_bounds(address, count)) return Answer::OutOfRange;
    const Guard guard = guard_of_change(address, count, before);
    if (guard != Guard::None && !owner_.may_change(guard)) return Answer::Refused;
    const uint16_t sequence = word(reg::command_sequence);
    constexpr uint16_t PLACE = reg::command_sequence;
    const bool given = PLACE >= address && PLACE - address < count;
    if (!given || sequence == before[PLACE - address]) return Answer::Ok;
    const auto command = static_cast<Command>(word(reg::command));
    const bool accepted = guard == Guard::None && owner_.command(command, sequence);
    return accepted ? Answer::Ok : Answer::Refused;
}

Answer Bank::write(uint16_t address, uint16_t count, const uint8_t *bytes) {
    if (!writable(address, count)) return Answer::NoRegister;
    uint16_t before[SETTINGS_WORDS];  // of the words written: each poll writes one
    memcpy(before, &words_[address], 2 * count);
    for (uint16_t i = 0; i < count; ++i)
        words_[address + i] = static_cast<uint16_t>(bytes[2 * i] << 8 | bytes[2 * i + 1]);
    const Answer answer = take(address, count, before);
    if (answer == Answer::Ok) {
        owner_.written(address, count);
    } else {
        memcpy(&words_[address], before, 2 * count);
    }
    return answer;
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
