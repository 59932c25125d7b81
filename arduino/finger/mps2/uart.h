// A serial port of the MPS2 board (Arm CMSDK APB UART).
#ifndef FINGER_MPS2_UART_H
#define FINGER_MPS2_UART_H

#include <stdint.h>

class Uart {
public:
    explicit Uart(uint32_t address) : registers_(reinterpret_cast<volatile uint32_t *>(address))
    {
        registers_[BAUD_DIVIDER] = 16;  // the smallest that is allowed
        registers_[CONTROL] = 3;        // transmit and receive
    }

    bool readable() const { return registers_[STATE] & 2; }
    uint8_t read() { return uint8_t(registers_[DATA]); }

    void write(uint8_t byte)
    {
        while (registers_[STATE] & 1) {}
        registers_[DATA] = byte;
    }

private:
    enum Register { DATA = 0, STATE = 1, CONTROL = 2, BAUD_DIVIDER = 4 };
    volatile uint32_t *registers_;
};

#endif
