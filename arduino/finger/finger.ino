// The finger board on a Teensy 4.0, for the Arduino IDE with Teensyduino. It has never run on a
// board: it is compiled against a stub of the Teensy core (tests/firmware/teensy), and everything
// behind it runs on this computer and on a simulated Cortex-M7.
//
// Needs cobs.* and crc32.* of the taxel board beside it: make -C arduino finger-sketch puts all
// files in one folder that the IDE opens.
#include "board.h"
#include "finger.h"
#include "model.h"
#include "taxel_line.h"

#ifdef ARDUINO
#include <Arduino.h>
#endif

namespace {

// USB: the baud rate has no meaning.
class UsbLine final : public HostLine {
public:
    bool send(const uint8_t *bytes, uint8_t size) override
    {
        if (Serial.availableForWrite() < size) return false;
        Serial.write(bytes, size);
        return true;
    }
};

UsbLine line;
Finger finger(line, MODEL);
TaxelLine taxel_line;

IntervalTimer every_ms;
volatile bool sample_ready = false;
volatile uint16_t lost = 0;         // conversions since the last sample that found no room
volatile uint16_t lost_before = 0;  // the same before the sample that is ready
Sample converted;

// Runs every millisecond; one row of taxels after the other.
void convert()
{
    if (sample_ready) {
        lost++;
        return;
    }
    for (uint8_t row = 0; row < 3; row++) {
        digitalWriteFast(LINE_PIN[row], HIGH);
        delayMicroseconds(SETTLE_US);
        for (uint8_t column = 0; column < 3; column++)
            converted.reading[3 * row + column] = uint16_t(analogRead(INPUT_PIN[column]));
        digitalWriteFast(LINE_PIN[row], LOW);
    }
    lost_before = lost;
    lost = 0;
    sample_ready = true;
}

void begin_converter()
{
    analogReadResolution(10);
    for (uint8_t pin : LINE_PIN) pinMode(pin, OUTPUT);
    every_ms.begin(convert, 1000);
}

void take_converted()
{
    if (!sample_ready) return;
    noInterrupts();
    Sample sample = converted;
    const uint16_t before = lost_before;
    sample_ready = false;
    interrupts();
    finger.take_sample(sample, before);
}

void take_taxel_byte()
{
    Sample sample;
    if (!taxel_line.feed(uint8_t(Serial1.read()), sample)) return;
    finger.set_damaged_frames(taxel_line.damaged());
    finger.take_sample(sample, taxel_line.lost());
}

}  // namespace

void setup()
{
    Serial.begin(TAXEL_BOARD_BAUD);
    if (TAXEL_BOARD_FITTED) Serial1.begin(TAXEL_BOARD_BAUD);
    else begin_converter();
    finger.begin();
}

void loop()
{
    while (Serial.available()) finger.receive(uint8_t(Serial.read()));
    if (!TAXEL_BOARD_FITTED) take_converted();
    else if (Serial1.available()) take_taxel_byte();
}
