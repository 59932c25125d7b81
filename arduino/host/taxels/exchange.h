// What the bench and the taxels' virtual board tell each other between two runs;
// rigctl/simulation/boards/taxel_firmware.py mirrors it and compares its size when the library is loaded.
#ifndef HOST_TAXELS_EXCHANGE_H
#define HOST_TAXELS_EXCHANGE_H

#include <stdint.h>

constexpr int32_t MOST_FRAMES = 4096, MOST_BYTES = 65536;

enum class EdgeOf : int64_t { Sync = 0, Index = 1 };

struct Exchange {
    int64_t tx_count;
    int64_t sent_at;                 // cycle at which all that was sent has left
    int64_t overflows;               // bytes that nobody took in time
    uint16_t readings[MOST_FRAMES][18];
    uint8_t flags[MOST_FRAMES];      // of the frames of the last run
    uint8_t edges[MOST_FRAMES];
    uint8_t tx[MOST_BYTES];
};

#endif  // HOST_TAXELS_EXCHANGE_H
