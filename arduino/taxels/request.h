// What the host asks: frames like the board's own, collected byte by byte.
#ifndef REQUEST_H
#define REQUEST_H

#include <stdint.h>

class RequestParser {
public:
    // Takes one byte of the wire. Returns the type of a request that it completed, else 0.
    uint8_t feed(uint8_t byte);

private:
    uint8_t frame_[16];
    uint8_t size_ = 0;  // sizeof frame_ + 1: too long, wait for the next zero
};

#endif  // REQUEST_H
