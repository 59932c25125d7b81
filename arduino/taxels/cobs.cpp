#include "cobs.h"

uint8_t cobs_encode(const uint8_t *body, uint8_t size, uint8_t *wire) {
    uint8_t *code = wire;
    uint8_t *out = wire + 1;
    for (uint8_t left = size; left; left--) {
        uint8_t byte = *body++;
        if (byte) {
            *out++ = byte;
        } else {
            *code = uint8_t(out - code);
            code = out++;
        }
    }
    *code = uint8_t(out - code);
    *out = 0;
    return uint8_t(size + 2);
}

uint8_t cobs_decode(uint8_t *frame, uint8_t size) {
    uint8_t from = 0, to = 0;
    while (from < size) {
        uint8_t run = frame[from++];
        if (run == 0 || uint8_t(run - 1) > uint8_t(size - from)) return 0;
        for (uint8_t i = 1; i < run; i++) frame[to++] = frame[from++];
        if (from < size) frame[to++] = 0;
    }
    return to;
}
