// The finger board on the PC: the chip's firmware core between two byte lines without a clock.
#ifndef HOST_FINGER_BOARD_H
#define HOST_FINGER_BOARD_H

#include <stdint.h>

#include <memory>

#include "finger.h"     // the firmware core
#include "finger_io.h"
#include "taxel_line.h"

class FingerBoard final : private HostLine {
public:
    // Resets the board; the reset cause is nothing that its core knows.
    void boot(uint8_t reset_cause);
    // Takes samples of the board's own converter from io.
    void run(int32_t samples);
    // Takes bytes of the taxel board's line.
    void receive_taxels(const uint8_t *bytes, int32_t count);
    // Takes bytes of the host.
    void receive(const uint8_t *bytes, int32_t count);

    FingerIO io = {};

private:
    bool send(const uint8_t *bytes, uint8_t size) override;

    std::unique_ptr<Finger> finger_;
    TaxelLine taxel_line_;
};

#endif  // HOST_FINGER_BOARD_H
