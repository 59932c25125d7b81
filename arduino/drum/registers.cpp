#include "registers.h"

Answer Registers::check_read(uint16_t address, uint16_t count) const {
    const uint32_t end = static_cast<uint32_t>(address) + count;
    return end <= MAP_END ? Answer::Ok : Answer::NoRegister;
}

uint16_t Registers::read(uint16_t address) const {
    if (address < COUNTERS_END) return bank_.word(address);
    return address < reg::ring_raw ? 0 : handler_.ring_word(address);
}

// Checks the new words and starts the command among them. A command relies on guarded settings, so
// one that comes together with a change of them is refused.
Answer Registers::accept(uint16_t address, uint16_t count, const uint16_t *before) {
    if (!bank_.in_bounds(address, count)) return Answer::OutOfRange;
    const Guard guard = bank_.guard_of_change(address, count, before);
    if (guard != Guard::None && !handler_.may_change(guard)) return Answer::Refused;
    const uint16_t sequence = bank_.word(reg::command_sequence);
    constexpr uint16_t PLACE = reg::command_sequence;
    const bool given = PLACE >= address && PLACE - address < count;
    if (!given || sequence == before[PLACE - address]) return Answer::Ok;
    const auto command = static_cast<Command>(bank_.word(reg::command));
    const bool accepted = guard == Guard::None && handler_.command(command, sequence);
    return accepted ? Answer::Ok : Answer::Refused;
}

Answer Registers::write(uint16_t address, uint16_t count, const uint8_t *bytes) {
    if (!bank_.writable(address, count)) return Answer::NoRegister;
    uint16_t *const words = bank_.words_at(address);
    uint16_t before[SETTINGS_WORDS];  // only of the words written, because each poll writes one
    memcpy(before, words, 2 * count);
    for (uint16_t i = 0; i < count; ++i)
        words[i] = static_cast<uint16_t>(bytes[2 * i] << 8 | bytes[2 * i + 1]);
    const Answer answer = accept(address, count, before);
    if (answer == Answer::Ok) handler_.written(address, count);
    else memcpy(words, before, 2 * count);
    return answer;
}
