#include "report.h"

#include "ports.h"    // stepper, clock, health
#include "variant.h"  // identity and geometry

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

void Report::fill_identity() {
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
}

void Report::refresh() {
    fill_state();
    fill_motion();
    fill_loadcell();
    fill_counters();
}

uint16_t Report::status_bits() const {
    const State state = controller_.machine().state();
    const Signals &signals = controller_.signals();
    const ForceControl &control = controller_.force_control();
    const bool holding = state == State::Hold || state == State::Run;
    const bool pressing = holding || state == State::Approach;
    return flag(Status::SyncHigh, ports::sync_line().high) |
           flag(Status::IndexHigh, signals.index_high()) |
           flag(Status::ForceSettled, holding && control.within_band()) |
           flag(Status::InContact, pressing && control.in_contact()) |
           flag(Status::SpeedConstant, ports::at_speed()) |
           flag(Status::EstopClosed, !signals.estop_wire_open()) |
           flag(Status::EndUp, signals.end_up()) | flag(Status::EndDown, signals.end_down()) |
           flag(Status::Homed, controller_.axis().homed()) |
           flag(Status::Tared, commands_.tared()) |
           flag(Status::ContactMayStand, !controller_.contact().gone()) |
           flag(Status::LiftFailed, controller_.contact().lift_failed()) |
           flag(Status::Commissioned, controller_.commission().holds()) |
           flag(Status::DirectionKnown, controller_.motion().known()) |
           flag(Status::CellTrusted, controller_.cell_trusted());
}

void Report::fill_state() {
    const Machine &machine = controller_.machine();
    bank_.put(reg::state, static_cast<uint16_t>(machine.state()));
    bank_.put(reg::fault, static_cast<uint16_t>(machine.fault()));
    bank_.put_wide(reg::fault_at_ms, machine.fault_at_ms());
    bank_.put_wide(reg::fault_bits, controller_.causes());
    bank_.put_wide(reg::board_time_us, ports::now_us());
    bank_.put(reg::command_acknowledged, commands_.acknowledged());
    bank_.put(reg::command_result, static_cast<uint16_t>(commands_.result()));
    bank_.put(reg::heartbeat_seen, controller_.heartbeat().value());
    bank_.put(reg::status_bits, status_bits());
}

void Report::fill_motion() {
    const Axis &axis = controller_.axis();
    const uint16_t speed = axis.speed();
    const ports::SyncLine sync = ports::sync_line();
    bank_.put_wide(reg::steps, static_cast<uint32_t>(ports::position()));
    bank_.put(reg::angle, hundredths_of_degree(axis.place_in_turn()));
    bank_.put(reg::speed, axis.backwards() ? -speed : speed);
    bank_.put(reg::sync_count, sync.count);
    bank_.put_wide(reg::sync_rise_us, sync.rise_us);
    bank_.put_wide(reg::sync_fall_us, sync.fall_us);
    bank_.put(reg::index_count, ports::index_mark().count);
    bank_.put(reg::actuator_position_um, controller_.signals().position_um());
    bank_.put(reg::actuator_drive, static_cast<uint16_t>(controller_.duty()));
    bank_.put(reg::last_contact_um, controller_.contact().contact_um());
}

void Report::fill_loadcell() {
    const Loadcell &cell = controller_.sensor().loadcell();
    const uint16_t newest = cell.sequence();
    bank_.put(reg::overrun_um, sampling::of(bank_.word(reg::loadcell_slow)).overrun_um);
    bank_.put(reg::force, tenths(cell.measured_g()));
    bank_.put(reg::loadcell_sequence, newest);
    bank_.put_wide(reg::loadcell_time_us, cell.time_us());
    for (uint8_t age = 0; age < LOADCELL_RECENT; ++age) {
        const int32_t raw = cell.ring_raw(static_cast<uint8_t>(newest - age));
        bank_.put_wide(reg::loadcell_recent + 2 * age, static_cast<uint32_t>(raw));
    }
}

void Report::fill_counters() {
    const ports::Health health = ports::health();
    bank_.put(reg::crc_errors, modbus_.crc_errors());
    bank_.put(reg::late_ticks, health.late_ticks);
    bank_.put(reg::frames_seen, modbus_.frames_seen());
    bank_.put(reg::exceptions_sent, modbus_.exceptions_sent());
    bank_.put(reg::longest_isr_us, health.longest_isr_us);
    bank_.put(reg::free_stack_bytes, health.free_stack_bytes);
    bank_.put(reg::idle_permille, health.idle_permille);
    const AmplifierTest &test = controller_.sensor().loadcell().test();
    bank_.put(reg::loadcell_rate, controller_.sensor().loadcell().rate());
    bank_.put(reg::loadcell_spikes, controller_.sensor().loadcell().spikes());
    bank_.put(reg::loadcell_noise, test.noise_tenths());
    bank_.put(reg::loadcell_unique, test.unique());
    bank_.put(reg::loadcell_dropped, controller_.sensor().loadcell().dropped());
    bank_.put_wide(reg::settings_hash, controller_.commission().hash());
    bank_.put(reg::position_raw, controller_.signals().position_raw());
    bank_.put(reg::nudge_travel_um, static_cast<uint16_t>(controller_.nudge().travel_um()));
    bank_.put(reg::nudge_duty, controller_.nudge().duty());
    bank_.put(reg::index_error_steps, static_cast<uint16_t>(controller_.axis().index_error()));
}
