#include "drum.h"

#include "ports.h"  // saved settings

void Drum::boot(bool watchdog_reset) {
    controller_.restore_defaults();
    SettingsFrom from = ports::load(bank_.settings());
    if (from == SettingsFrom::Saved && !bank_.settings_valid()) {
        controller_.restore_defaults();
        from = SettingsFrom::Damaged;
    }
    bank_.put(reg::settings_from, static_cast<uint16_t>(from));
    report_.fill_identity();
    controller_.apply_settings();
    controller_.boot(watchdog_reset);
}

void Drum::tick(const Inputs &inputs) {
    controller_.tick(inputs);
    commands_.tick();
}

void Drum::sample(const Conversion &conversion) {
    if (controller_.sample(conversion)) commands_.sample(conversion.raw);
}

uint16_t Drum::ring_word(uint16_t address) {
    const bool time = address >= reg::ring_time_us;
    const uint16_t offset = address - (time ? reg::ring_time_us : reg::ring_raw);
    const uint8_t place = offset / 2;
    const uint32_t value = time ? loadcell().ring_time_us(place)
                                : static_cast<uint32_t>(loadcell().ring_raw(place));
    return static_cast<uint16_t>(offset & 1 ? value : value >> 16);
}

void Drum::written(uint16_t address, uint16_t count) {
    const auto includes = [&](uint16_t place) {
        return place >= address && place - address < count;
    };
    if (includes(reg::heartbeat)) controller_.take_heartbeat();
    if (address + count <= reg::signal_polarity) return;  // heartbeat and command only
    if (includes(reg::tare_counts) || includes(reg::tare_counts + 1)) commands_.tare_written();
    controller_.apply_settings();
}
