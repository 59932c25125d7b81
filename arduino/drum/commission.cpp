#include "commission.h"

#include "variant.h"  // the bench that the image is built for

namespace {

// FNV-1a, by words.
constexpr uint32_t with(uint32_t hash, uint32_t value) { return (hash ^ value) * 16777619UL; }

constexpr uint32_t OF_BOARD =
    with(with(with(with(with(with(2166136261UL, board::STEPS_PER_TURN), board::NM_PER_TURN),
                   static_cast<uint32_t>(board::ACTUATOR_MAX_MM_S * 1000)),
              board::ACTUATOR_TRAVEL_UM),
         board::LOADCELL_SLOW_PERIOD_US), board::UG_PER_COUNT);

}  // namespace

void Commission::configure(const Bank &bank) {
    uint32_t hash = with(OF_BOARD, bank.word(reg::optional_signals));
    hash = with(hash, bank.word(reg::signal_polarity));
    hash = with(hash, bank.word(reg::loadcell_slow));
    hash = with(hash, static_cast<uint32_t>(bank.wide(reg::scale_ug_per_count)));
    hash_ = hash ? hash : 1;  // 0 is an EEPROM without any
}
