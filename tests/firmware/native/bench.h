// The drum's body on the PC: steps in time, an actuator on a screw, a skin, a load cell.
//
// It implements ports.h and calls the brain as the chip does: a conversion when it is ready, a
// tick each millisecond. One bench exists at a time.
#ifndef BENCH_H
#define BENCH_H

#include <cstdint>
#include <deque>
#include <functional>
#include <random>
#include <vector>

#include "drum.h"
#include "ports.h"
#include "potentiometer.h"

struct BenchParameters {
    double actuator_speed_mm_s = 10, lag_ms = 30, dead_band = 0.08, stiction = 0.01;
    double backlash_mm = 0.05, weight_g = 1500, start_mm = 5, contact_mm = 20;
    double stiffness_g_mm = 600, stiffening_per_mm = 0.1;
    double run_out_mm = 0.05, run_out_phase = 0.7, ripple_mm = 0, ripple_period_mm = 6;
    double moved_mass_g = 500, imbalance_g = 1, noise_g = 0.3, average_ms = 10;
    double conversion_us = 12401, offset_counts = 80000, ug_per_count = 2400;
    unsigned seed = 1;
};

class Bench {
  public:
    explicit Bench(const BenchParameters &parameters = {});
    ~Bench();

    // Runs for so many milliseconds, or until the condition holds; false when it never did.
    void run(int ms);
    bool run_until(const std::function<bool()> &condition, int limit_ms);

    // Writes through the register bank as a computer would.
    Answer write(uint16_t address, std::initializer_list<uint16_t> words);
    Answer write_wide(uint16_t address, int32_t value);
    Answer command(Command command);
    uint16_t read(uint16_t address);
    int32_t read_wide(uint16_t address);
    CommandResult result() { return static_cast<CommandResult>(read(reg::command_result)); }
    bool finish(int limit_ms);  // waits for the running command; true when it was DONE

    State state() const { return drum.machine().state(); }
    bool commission();
    // A finger presses on the load cell for a moment, while the board drives nothing.
    void touch_cell();
    bool arm_and_tare();
    bool hold(double force_g, int limit_ms = 15000);

    Drum drum;
    BenchParameters p;
    uint32_t time_ms = 0;

    // Switches and wires that a test may pull.
    bool beating = true, estop_open = false, end_up = false, end_down = false;
    bool loadcell_silent = false, loadcell_frozen = false, loadcell_saturated = false;
    bool out_of_step = false, mark_hidden = false, actuator_jammed = false;
    bool cell_open = false;  // its excitation: it reads noise about its zero
    bool swapped_actuator = false, swapped_ends = false;
    bool upper_end_open = false;  // its wire, which reads as the upper end
    int broken_position = -1;  // a reading, where its wires are broken
    bool inverted_ends = false, inverted_position = false;
    double push_g = 0;

    // What the bench really does.
    double force_g = 0, rod_mm = 0, drum_mm = 0, peak_g = 0;
    int16_t drive_permille = 0;
    bool stepper_on = false, bridge_on = false, saving = false;
    uint32_t commissioned = 0;
    ports::Place place = {0, 0};
    std::vector<uint32_t> step_cycles;  // of the steps since clear
    bool keep_steps = false;
    StepEngine engine;
    ports::SyncLine sync = {0, 0, 0, false};
    ports::IndexMark mark = {0, 0};
    std::function<void()> each_ms;

    uint32_t now_us() const { return time_ms * 1000; }
    void start(const Motion &motion);
    void make_steps();

  private:
    void one_ms();
    void move_actuator();
    void touch();
    void convert();
    double rod_force(double depth_mm) const;

    std::mt19937 random_;
    std::normal_distribution<double> normal_{0, 1};
    std::deque<double> felt_;
    Potentiometer position_;
    double velocity_ = 0, next_conversion_us_ = 20000;
    uint64_t next_step_q8_ = 0;  // cycles times 256
    int32_t last_raw_ = 0;
    uint16_t sequence_ = 0, beat_ = 0;
    int32_t true_steps_ = 0;
};

#endif  // BENCH_H
