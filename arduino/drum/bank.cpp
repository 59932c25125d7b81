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
        const Kind kind = flash::load(&SETTINGS[i]).kind;
        for (uint8_t w = 0; w <= is_wide(kind); ++w) {
            const uint16_t place = first + w;
            covered += place >= address && place - address < count;
        }
    }
    return covered == count;
}

// Whether the settings that stand in these words now may stand there, instead of those before.
Answer Bank::judge(uint16_t address, uint16_t count, const uint16_t *before) const {
    Answer answer = Answer::Ok;
    for (uint8_t i = 0; i < SETTING_COUNT; ++i) {
        const uint16_t first = flash::word_at(&SETTINGS[i].address);
        if (first + 1 < address) continue;
        if (first >= address && first - address >= count) break;
        const Setting setting = flash::load(&SETTINGS[i]);
        if (!inside(setting, &words_[first])) return Answer::OutOfRange;
        const uint16_t *old = before + (first - SETTINGS_START);
        const bool changed = words_[first] != old[0] ||
                             (is_wide(setting.kind) && words_[first + 1] != old[1]);
        if (setting.guard != Guard::None && changed && !owner_.may_change(setting.guard))
            answer = Answer::Refused;
    }
    return answer;
}

bool Bank::settings_valid() const {
    const uint16_t *same = &words_[SETTINGS_START];
    return judge(SETTINGS_START, SETTINGS_WORDS, same) == Answer::Ok;
}

Answer Bank::write(uint16_t address, uint16_t count, const uint8_t *bytes) {
    if (!writable(address, count)) return Answer::NoRegister;
    uint16_t before[SETTINGS_WORDS];
    memcpy(before, settings(), sizeof before);
    for (uint16_t i = 0; i < count; ++i)
        words_[address + i] = static_cast<uint16_t>(bytes[2 * i] << 8 | bytes[2 * i + 1]);
    Answer answer = judge(address, count, before);
    const uint16_t sequence = word(reg::command_sequence);
    if (answer == Answer::Ok && sequence != before[reg::command_sequence - SETTINGS_START] &&
        !owner_.command(static_cast<Command>(word(reg::command)), sequence))
        answer = Answer::Refused;
    if (answer == Answer::Ok) {
        owner_.written(address, count);
    } else {
        memcpy(settings(), before, sizeof before);
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
