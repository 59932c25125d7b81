// The readable registers, brought up to date once before each read.
#include "variant.h"     // identity and geometry
#include "drum.h"

namespace {

uint16_t tenths(float value) {
    const float scaled = value * 10.0f + (value < 0 ? -0.5f : 0.5f);
    if (scaled > 32767.0f) return 32767;
    if (scaled < -32767.0f) return static_cast<uint16_t>(-32767);
    return static_cast<uint16_t>(static_cast<int16_t>(scaled));
}

// A multiplication and a shift where a division would cost 40 µs.
uint16_t hundredths_of_degree(uint16_t place) {
    constexpr uint32_t TIMES_65536 = (36000ULL << 16) / board::STEPS_PER_TURN;
    return place * TIMES_65536 >> 16;
}

uint16_t flag(Status status, bool on) {
    return on ? 1u << static_cast<uint8_t>(status) : 0;
}

}  // namespace

void Drum::refresh() {
    report_state();
    report_motion();
    report_loadcell();
    report_counters();
}

void Drum::report_identity() {
    const ports::Health health = ports::health();
    bank_.put(reg::magic, MAGIC);
    bank_.put(reg::map_version, MAP_VERSION);
    bank_.put(reg::board_id, BOARD_DRUM);
    bank_.put(reg::firmware_version, board::FIRMWARE_MAJOR << 8 | board::FIRMWARE_MINOR);
    bank_.put_wide(reg::build_hash, BUILD_HASH);
    bank_.put(reg::boot_count, health.boot_count);
    bank_.put(reg::reset_cause, health.reset_cause);
    bank_.put(reg::ring_depth, RING_DEPTH);
    bank_.put(reg::steps_per_turn, board::STEPS_PER_TURN);
    bank_.put_wide(reg::nm_per_step, board::NM_PER_STEP);
    bank_.put(reg::most_force, board::MOST_FORCE_G);
    bank_.put(reg::overrun_um, board::OVERRUN_UM);
}

uint16_t Drum::status_bits() const {
    const State state = machine_.state();
    const bool holding = state == State::Hold || state == State::Run;
    const bool pressing = holding || state == State::Approach;
    return flag(Status::SyncHigh, ports::sync_line().high) |
           flag(Status::IndexHigh, inputs_.index_high) |
           flag(Status::ForceSettled, holding && within_band()) |
           flag(Status::InContact, pressing && force_.in_contact()) |
           flag(Status::SpeedConstant, ports::at_speed()) |
           flag(Status::EstopClosed, !inputs_.estop_open) |
           flag(Status::EndUp, end_up()) | flag(Status::EndDown, end_down()) |
           flag(Status::Homed, homed_) | flag(Status::Tared, tared_) |
           flag(Status::ContactMayStand, contact_ != Contact::Gone) |
           flag(Status::LiftFailed, lift_failed_);
}

void Drum::report_state() {
    bank_.put(reg::state, static_cast<uint16_t>(machine_.state()));
    bank_.put(reg::fault, static_cast<uint16_t>(machine_.fault()));
    bank_.put_wide(reg::fault_at_ms, machine_.fault_at_ms());
    bank_.put(reg::fault_bits, causes());
    bank_.put_wide(reg::board_time_us, ports::now_us());
    bank_.put(reg::command_acknowledged, acknowledged_);
    bank_.put(reg::command_result, static_cast<uint16_t>(result_));
    bank_.put(reg::heartbeat_seen, heartbeat_.value());
    bank_.put(reg::status_bits, status_bits());
}

void Drum::report_motion() {
    const int32_t steps = ports::position();
    int32_t place = steps % board::STEPS_PER_TURN;
    if (place < 0) place += board::STEPS_PER_TURN;
    const uint16_t speed = ports::at_speed() ? cruise_speed_ : ramp::speed_of(ports::step_interval());
    const ports::SyncLine sync = ports::sync_line();
    bank_.put_wide(reg::steps, static_cast<uint32_t>(steps));
    bank_.put(reg::angle, hundredths_of_degree(place));
    bank_.put(reg::speed, backwards_ ? -speed : speed);
    bank_.put(reg::sync_count, sync.count);
    bank_.put_wide(reg::sync_rise_us, sync.rise_us);
    bank_.put_wide(reg::sync_fall_us, sync.fall_us);
    bank_.put(reg::index_count, ports::index_mark().count);
    bank_.put(reg::actuator_position_um, inputs_.position_um);
    bank_.put(reg::actuator_drive, static_cast<uint16_t>(permille_));
    bank_.put(reg::last_contact_um, contact_um_);
}

void Drum::report_loadcell() {
    const uint16_t newest = loadcell_.sequence();
    bank_.put(reg::force, tenths(loadcell_.force_g()));
    bank_.put(reg::loadcell_sequence, newest);
    bank_.put_wide(reg::loadcell_time_us, loadcell_.time_us());
    for (uint8_t age = 0; age < LOADCELL_RECENT; ++age) {
        const int32_t raw = loadcell_.ring_raw(static_cast<uint8_t>(newest - age));
        bank_.put_wide(reg::loadcell_recent + 2 * age, static_cast<uint32_t>(raw));
    }
}

void Drum::report_counters() {
    const ports::Health health = ports::health();
    bank_.put(reg::crc_errors, modbus_.crc_errors());
    bank_.put(reg::late_ticks, health.late_ticks);
    bank_.put(reg::frames_seen, modbus_.frames_seen());
    bank_.put(reg::exceptions_sent, modbus_.exceptions_sent());
    bank_.put(reg::longest_isr_us, health.longest_isr_us);
    bank_.put(reg::free_stack_bytes, health.free_stack_bytes);
    bank_.put(reg::idle_permille, health.idle_permille);
    bank_.put(reg::loadcell_dropped, loadcell_.dropped());
    bank_.put(reg::index_error_steps, static_cast<uint16_t>(index_error_));
}

uint16_t Drum::ring_word(uint16_t address) {
    const bool time = address >= reg::ring_time_us;
    const uint16_t offset = address - (time ? reg::ring_time_us : reg::ring_raw);
    const uint8_t place = offset / 2;
    const uint32_t value = time ? loadcell_.ring_time_us(place)
                                : static_cast<uint32_t>(loadcell_.ring_raw(place));
    return static_cast<uint16_t>(offset & 1 ? value : value >> 16);
}
