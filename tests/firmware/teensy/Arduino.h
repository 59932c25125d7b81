// A stub of the Teensy core: the functions that arduino/finger/finger.ino calls, without bodies.
// It shows that the sketch compiles for the chip; nothing here runs.
#ifndef TEENSY_STUB_ARDUINO_H
#define TEENSY_STUB_ARDUINO_H

#include <stddef.h>
#include <stdint.h>

const uint8_t LOW = 0, HIGH = 1, INPUT = 0, OUTPUT = 1;

class SerialPort {
public:
    void begin(uint32_t baud);
    int available();
    int read();
    int availableForWrite();
    size_t write(const uint8_t *bytes, size_t size);
};

extern SerialPort Serial, Serial1;

class IntervalTimer {
public:
    bool begin(void (*function)(), uint32_t period_us);
};

void pinMode(uint8_t pin, uint8_t mode);
void digitalWriteFast(uint8_t pin, uint8_t level);
int analogRead(uint8_t pin);
void analogReadResolution(unsigned int bits);
void delayMicroseconds(uint32_t time_us);
void noInterrupts();
void interrupts();

#endif
