// The drum board on the PC: the chip's firmware core with simulated hardware that counts cycles.
//
// The owner of the bench runs it up to a cycle. Ticks, steps, conversions and bytes happen in the
// order of their cycles, each without computing time. Boards share only the pointer to the running
// board, so that one process may hold many.
#ifndef HOST_DRUM_BOARD_H
#define HOST_DRUM_BOARD_H

#include <stdint.h>

#include <array>
#include <memory>

#include "../serial_line.h"
#include "drum.h"           // the firmware core
#include "drum_io.h"
#include "ports.h"          // functions that the core calls
#include "potentiometer.h"  // smoothing of its readings
#include "store.h"          // boot count, saved settings

class DrumBoard {
  public:
    DrumBoard();

    // Resets and boots, with the reset cause in the chip's MCUSR; the EEPROM persists.
    void boot(uint8_t reset_cause);
    void run(uint64_t until_cycle);
    void receive(const uint8_t *bytes, int32_t count, uint64_t from_cycle);
    // Accesses registers like a Modbus master; returns a Modbus exception code, 0 for success.
    int32_t write(uint16_t address, uint16_t count, const uint8_t *bytes);
    void read(uint16_t address, uint16_t count, uint16_t *words);
    void poll();
    // Writes the next heartbeat, like a host.
    void beat();
    // Turns the drum to a step behind its mark.
    void place(int64_t steps);
    // Sets the level of the emergency stop's wire: high is open.
    void set_estop(bool level);

    DrumIO io = {};

    // Implementation of ports.h for the running board.
    uint32_t now_us() const { return static_cast<uint32_t>((cycle_ - booted_) / CYCLES_PER_US); }
    ports::Health health() const;
    void enable_stepper(bool on);
    void start(const Motion &motion);
    void stop_gently();
    void stop_at_once();
    bool moving() const { return engine_.moving(); }
    const StepEngine &engine() const { return engine_; }
    void shift_position(int32_t by) { engine_.set_position(engine_.position() + by); }
    const ports::SyncLine &sync_line() const { return sync_; }
    const ports::IndexMark &index_mark() const { return mark_; }
    void wire_signals(uint8_t fitted, uint8_t inverted);
    void enable_bridge(bool on);
    void drive(int16_t permille);
    Store &store() { return store_; }
    uint8_t &stored(uint16_t address) { return eeprom_.at(address); }

  private:
    static constexpr uint64_t CYCLES_PER_US = 16, CYCLES_PER_TICK = 16000;
    static constexpr uint64_t LONGEST_STEP = 80000;  // slower steps are single movements
    static constexpr uint64_t SEND_SIZE = 512;       // ring of the chip's transmitter
    static constexpr double BYTE_CYCLES = 10 * 16e6 / BAUD;

    uint64_t next_event() const;
    void happen();
    void tick();
    void step();
    void convert();
    void take_byte();
    void turn(bool backwards);
    void show_mark();
    void move_sync(Mark mark);
    void show_sync(bool on);
    void cut();
    bool estop_open() const;
    void look_at_estop();
    void report();
    void count_duty();
    void send_out();
    void report_edge(EdgeOf signal, bool level);
    double place_now() const;

    std::unique_ptr<Drum> drum_;
    StepEngine engine_;
    Potentiometer potentiometer_;
    Store store_;
    std::array<uint8_t, 4096> eeprom_;
    SerialLine to_board_{BYTE_CYCLES}, to_host_{BYTE_CYCLES};
    uint64_t cycle_ = 0, booted_ = 0, next_tick_ = 0;
    uint64_t next_step_q8_ = 0;                // cycle times 256
    uint32_t milliseconds_ = 0;
    ports::SyncLine sync_ = {0, 0, 0, false};
    ports::IndexMark mark_ = {0, 0};
    double steps_ = 0;                         // position commanded by the last step
    double from_ = 0;                          // position at that step
    uint64_t stepped_ = 0, step_length_ = 0;   // cycle of the last step, time from the one before
    bool stepper_on_ = false, bridge_on_ = false;
    bool sync_fitted_ = true, sync_inverted_ = false, sync_level_ = false;
    bool index_inverted_ = false, index_pin_ = false, mark_level_ = false;
    bool estop_fitted_ = true, estop_inverted_ = false, estop_level_ = false;
    bool estop_latched_ = false, estop_told_ = false;
    int16_t permille_ = 0;
    double duty_sum_ = 0;
    uint64_t duty_since_ = 0;
    uint8_t reset_cause_ = 0;
    uint16_t beat_ = 0;
};

#endif  // HOST_DRUM_BOARD_H
