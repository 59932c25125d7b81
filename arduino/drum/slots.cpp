#include "slots.h"

#include <string.h>

#include "modbus.h"  // its CRC
#include "ports.h"   // what is stored

namespace {

constexpr uint16_t CRC_START = 0x1d0f;  // not 0xffff: blank memory must not check

}  // namespace

uint16_t Slots::word_at(uint16_t address) const {
    return static_cast<uint16_t>(ports::stored_byte(address) | ports::stored_byte(address + 1) << 8);
}

uint16_t Slots::checksum(uint16_t address) const {
    uint16_t crc = CRC_START;
    for (uint8_t i = 0; i < whole(); ++i) crc = Modbus::crc_step(crc, ports::stored_byte(address + i));
    return crc;
}

bool Slots::is_whole(uint16_t address) const {
    return word_at(address + whole()) == checksum(address);
}

// Returns the slot with the newer words, -1 if neither is whole.
int8_t Slots::newest() const {
    const bool first = is_whole(start_), second = is_whole(start_ + stride_);
    if (!first || !second) return first ? 0 : second ? 1 : -1;
    const uint16_t ahead = word_at(start_ + stride_) - word_at(start_);
    return static_cast<int16_t>(ahead) > 0;
}

bool Slots::is_blank() const {
    for (uint8_t i = 0; i < whole() + 2; ++i)
        if ((ports::stored_byte(start_ + i) & ports::stored_byte(start_ + stride_ + i)) != 0xff) return false;
    return true;
}

Slots::Found Slots::load(uint16_t *words) const {
    const int8_t slot = newest();
    if (slot < 0) return is_blank() ? Found::Nothing : Found::Damaged;
    const uint16_t address = start_ + slot * stride_ + 2;
    for (uint8_t i = 0; i < count_; ++i) words[i] = word_at(address + 2 * i);
    return Found::Whole;
}

void Slots::begin_save(const uint16_t *words) {
    const int8_t slot = newest();
    const uint16_t version = slot < 0 ? 1 : word_at(start_ + slot * stride_) + 1;
    address_ = start_ + (slot == 0 ? stride_ : 0);
    memcpy(bytes_, &version, sizeof version);
    memcpy(bytes_ + 2, words, 2 * count_);
    uint16_t crc = CRC_START;
    for (uint8_t i = 0; i < whole(); ++i) crc = Modbus::crc_step(crc, bytes_[i]);
    memcpy(bytes_ + whole(), &crc, sizeof crc);
    size_ = whole() + 2;
    done_ = 0;
}

uint8_t Slots::next(uint16_t &address) {
    address = address_ + done_;
    return bytes_[done_++];
}
