// Inputs and outputs of the virtual taxel board; rigctl/bench/boards/taxels.py mirrors
// this struct and checks its size when it loads the library.
#ifndef HOST_TAXEL_IO_H
#define HOST_TAXEL_IO_H

#include <stdint.h>

constexpr int32_t MAX_FRAMES = 4096, MAX_BYTES = 65536;

enum class EdgeOf : int64_t { Sync = 0, Index = 1 };

struct TaxelIO {
    int64_t supply_mv;               // from the bench
    int64_t tx_count;
    int64_t overflows;               // bytes lost because the buffer was full
    uint8_t flags[MAX_FRAMES];      // of the frames of the last run
    uint8_t edges[MAX_FRAMES];
    uint8_t tx[MAX_BYTES];
};

#endif  // HOST_TAXEL_IO_H
