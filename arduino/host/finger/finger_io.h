// Inputs and outputs of the virtual finger board; rigctl/finger/bench/firmware.py
// mirrors this struct and checks its size when it loads the library.
#ifndef HOST_FINGER_IO_H
#define HOST_FINGER_IO_H

#include <stdint.h>

constexpr int32_t MAX_SAMPLES = 4096, MAX_BYTES = 262144;

struct FingerIO {
    int64_t tx_count;
    int64_t overflows;              // frames lost because the buffer was full
    uint16_t readings[MAX_SAMPLES][9];
    uint8_t tx[MAX_BYTES];
};

#endif  // HOST_FINGER_IO_H
