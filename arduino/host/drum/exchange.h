// What the bench and the drum's virtual board tell each other between two runs.
//
// Whole numbers first, then reals, then what comes in rows: rigctl/simulation/boards/drum_firmware.py mirrors it,
// and compares its size when the library is loaded.
#ifndef HOST_DRUM_EXCHANGE_H
#define HOST_DRUM_EXCHANGE_H

#include <stdint.h>

constexpr int32_t MOST_BYTES = 8192, MOST_EDGES = 4096, MOST_POLL_WORDS = 64;

enum class EdgeOf : int64_t { Sync = 0, Index = 1 };

struct Exchange {
    // From the bench, kept until changed.
    int64_t potentiometer;       // reading of ten bits
    int64_t end_up, end_down;    // levels of the end switches' wires
    int64_t motor_jammed;
    int64_t mark_length_steps;   // the index mark covers these steps of a turn, 0: no wire
    int64_t mark_inverted;
    int64_t poll_address, poll_count;
    int64_t attended;            // the board's own computer beats, as one that is alive
    // From the bench, taken by the next run.
    int64_t conversion_due;
    int64_t conversion_cycle, conversion_counts;
    // From the board.
    int64_t state, fault, result;
    int64_t changes;             // how often one of these three changed
    int64_t sequence;            // of the newest load-cell sample
    int64_t booted;              // cycle of the last boot
    int64_t received_at;         // cycle at which all that was received is there
    int64_t sent_at;             // cycle at which all that was sent has left
    int64_t tx_count, edge_count;
    int64_t overflows;           // bytes and edges that nobody took in time
    double drive;                // mean duty of the actuator in the last run, positive presses
    double place;                // of the drum at its end, steps
    int64_t tx_cycle[MOST_BYTES], edge_cycle[MOST_EDGES];
    int64_t edge_signal[MOST_EDGES], edge_level[MOST_EDGES];
    uint8_t tx[MOST_BYTES];
    uint16_t poll_words[MOST_POLL_WORDS];
};

#endif  // HOST_DRUM_EXCHANGE_H
