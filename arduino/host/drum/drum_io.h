// Inputs and outputs of the drum's virtual board.
//
// Integers first, then floats, then arrays: rigctl/bench/boards/drum_firmware.py mirrors this
// struct and checks its size when it loads the library.
#ifndef HOST_DRUM_IO_H
#define HOST_DRUM_IO_H

#include <stdint.h>

constexpr int32_t MAX_BYTES = 8192, MAX_EDGES = 4096, MAX_POLL_WORDS = 64;

enum class EdgeOf : int64_t { Sync = 0, Index = 1 };

struct DrumIO {
    // From the bench, valid until changed.
    int64_t potentiometer;       // reading of ten bits
    int64_t end_up, end_down;    // levels of the end switches' wires
    int64_t motor_jammed;
    int64_t direction;           // 0: as drawn, 1: reversed, 2: always forwards
    int64_t steps_per_turn;      // from one index mark to the next
    int64_t mark_length_steps;   // the index mark covers these steps of a turn, 0: no wire
    int64_t mark_inverted;
    int64_t poll_address, poll_count;
    int64_t heartbeat_on;        // the board has a heartbeat without a host
    // From the bench, consumed by the next run.
    int64_t conversion_due;
    int64_t conversion_cycle, conversion_counts, conversion_in_step;
    // From the board.
    int64_t state, fault, result;
    int64_t change_count;        // how often one of these three changed
    int64_t sample_sequence;     // of the newest load-cell sample
    int64_t boot_cycle;          // of the last boot
    int64_t rx_end_cycle;        // at which the last byte received is complete
    int64_t bridge_on, stepper_on;
    int64_t tx_count, edge_count;
    int64_t overflows;           // bytes and edges lost because the buffers were full
    double step_size;            // steps by which a pulse turns the drum; from the bench
    double drive;                // mean duty of the actuator in the last run, positive presses
    double position;             // of the drum at its end, steps
    int64_t tx_cycle[MAX_BYTES], edge_cycle[MAX_EDGES];
    int64_t edge_signal[MAX_EDGES], edge_level[MAX_EDGES];
    uint8_t tx[MAX_BYTES];
    uint16_t poll_words[MAX_POLL_WORDS];
};

#endif  // HOST_DRUM_IO_H
